"""The control plane in one process: every decision and every fault follows from a seed.

Control loops, workers and users are greenlets over the product's own code and real SQL (SQLite in memory). The clock, the
broker and the store are simulated. Before each transaction, message and object, and while a product is made, other processes
go on. Transactions themselves are never interrupted.
"""
