"""Training the built-in networks on rendered frames; nothing here is needed to run a trained one."""
