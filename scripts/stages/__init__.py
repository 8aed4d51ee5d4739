"""The stages of the experiment, each from objects to what its file holds: plan, library, sweep and more."""
