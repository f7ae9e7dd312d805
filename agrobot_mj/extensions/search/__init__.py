"""Search many runs for limits of laws, rare failures, small failing changes, important parameters, and gains."""
