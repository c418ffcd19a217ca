"""One file per command; `zwidth.cli` lists them and loads only the requested one."""
