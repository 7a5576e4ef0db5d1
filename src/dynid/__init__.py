"""dynid identifies the dynamic parameters of robot arms and finds what the model still misses.

Three loops and a fourth: ``model`` (DH file to base regressor), ``trajectory`` and ``record`` (excitation),
``parameters`` and ``identify`` (least squares on a log), and ``gap`` (name the effect that is missing).
"""

__version__ = "0.1.0"
