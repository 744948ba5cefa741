"""Simulate the control plane in one process; a seed determines every decision and every fault.

Control loops, workers and users are greenlets that run the product's own code and real SQL (SQLite in memory). The clock, the
broker and the store are simulated. Other processes may run before each transaction, message and object, and while a product
is made. Transactions are never interrupted.
"""
