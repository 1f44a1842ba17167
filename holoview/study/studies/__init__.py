"""One study a file, as `STUDY`: what is put here is found by `holoview study`."""
