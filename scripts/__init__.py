"""The command line `slcp`: its table; each command is a thin file of `commands/`."""

from .support.checkout import further_folders

__path__ += further_folders(__path__)
