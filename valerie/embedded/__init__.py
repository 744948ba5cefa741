"""The one-machine mode: Redis, the API and one worker per queue, as processes that end with the command."""
