"""The flying process: the module, what waits for it and watches over it, its log."""
