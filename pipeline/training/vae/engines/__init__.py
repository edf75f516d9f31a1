"""Engines that compute the same gradients: reference, simd, cuda."""
