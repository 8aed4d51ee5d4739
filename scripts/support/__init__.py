"""What the commands share: errors, progress, the commands' files and tables."""
