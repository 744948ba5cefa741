"""One world for the tests: a deployment in this process, with the real database, store, control loop and stages.

Products come from the blank engine (`blank`), or from a drawn street (`drawn`) where tests need shaped scores within seconds,
without GL and torch.
"""
