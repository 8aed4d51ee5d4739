"""The broad phase of the generic kernels: which pairs can act, without a look at all of them."""
