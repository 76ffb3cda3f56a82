"""Pure bytes: register tables and codecs. No I/O, no clocks, nothing of any other room."""
