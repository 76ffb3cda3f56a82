"""The operator's page: a structure to look at and to command in a browser. A client of the operator's socket."""
