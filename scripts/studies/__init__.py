"""The paper's studies and some beyond it."""
