"""The command line `slcp`: one thin file per command."""
