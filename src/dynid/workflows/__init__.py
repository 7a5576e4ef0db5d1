"""One function per command, for programs and notebooks: options and objects in, frozen results out.

Nothing here prints, asks or parses a command line. Progress goes through ``dynid.progress``, questions are callbacks.
"""
