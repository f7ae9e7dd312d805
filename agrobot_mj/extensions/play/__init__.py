"""Interactive driving in a browser, by a driver at the keyboard or by a guidance law."""
