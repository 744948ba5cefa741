"""The one-machine mode: Redis, the API and one worker per queue, real processes that live and end with one command."""
