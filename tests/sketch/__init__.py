"""A drawn street instead of a rendered one: real runs in a real database within seconds, without GL and torch.

Everything but the pixels is the product's own: specs, digests, control loop, stages, codecs, evaluation, report.
"""
