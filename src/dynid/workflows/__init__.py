"""One function per command, for programs and notebooks: options and objects in, frozen results out.

Nothing here prints, asks or parses a command line. Progress goes through ``dynid.progress``, questions are callbacks.
Modules are imported when they are first used, so that help of a command does not wait for them.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
