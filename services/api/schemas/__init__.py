"""Read models, the answers of the API, one module per router. Requests are the documents of `valerie.runs`."""
