"""dynid identifies the dynamic parameters of robot arms and finds what the model still misses.

Three loops and a fourth: ``base_model`` (DH file to base regressor), ``plan_trajectory`` (excitation), ``identify`` and
``validate`` (least squares on a log), and ``find_gap`` (name the effect that is missing). Each of them takes objects
and returns objects; the command line calls the same functions.

    import dynid
    arm = dynid.load_robot("kuka_lwr4plus")
    result = dynid.identify(arm, [dynid.load_log("run1.bag", arm)])
    result.table()

Names are imported when they are first used, so ``import dynid`` costs nothing.
"""

import lazy_loader

from dynid.version import __version__ as __version__

#: The names stand in ``__init__.pyi``, which type checkers and editors read as well.
__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
