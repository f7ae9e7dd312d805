"""What a recording shows over time."""
