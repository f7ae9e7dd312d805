"""Interactive driving in a browser: a driver at the keyboard, or a guidance law that takes over."""
