"""The command line: one file per command, same name as the command."""
