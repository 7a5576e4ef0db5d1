"""Is this log fit to identify from? Driver columns -> DH quantities, with everything that is wrong named."""
