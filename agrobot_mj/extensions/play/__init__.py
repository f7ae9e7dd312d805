"""Interactive drives in a browser, controlled by the driver or by a guidance law."""
