"""Commands of `slcp`, one thin file each."""
