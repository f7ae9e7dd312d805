"""The tractor's numbers and its actuators, shared by all plants."""
