"""One module per resource; each endpoint is a few lines around a use case of `valerie.pipeline` or a query of `valerie.db`."""
