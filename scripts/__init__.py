"""The command line `slcp`: one thin file per command."""

from .support.checkout import further_folders

__path__ += further_folders(__path__)
