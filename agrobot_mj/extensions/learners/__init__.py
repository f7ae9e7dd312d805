"""Control laws and loops that learn while they drive."""
