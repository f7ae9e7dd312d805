"""Search for the value of a key at which a guidance law begins to fail: failure condition, runs with several seeds, and
reliability of the result."""
