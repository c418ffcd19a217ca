"""One file a command; `zwidth.cli` lists them and loads only the one that is asked for."""
