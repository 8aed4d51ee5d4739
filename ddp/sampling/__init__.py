"""Search by sampled controls: predictive sampling, the cross-entropy method, path integrals."""
