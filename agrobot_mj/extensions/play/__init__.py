"""Interactive driving in a browser, by keyboard or by a guidance law."""
