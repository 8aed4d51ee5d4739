"""The sections of the check of a GPU, a file each."""
