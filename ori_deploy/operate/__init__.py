"""Commands to a controller that runs in another terminal, over a local socket."""
