"""Read models: what the API answers with, one module per router. Requests are the documents of `valerie.runs`."""
