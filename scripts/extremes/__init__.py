"""Extreme inputs, one module an effect: each has ROWS(), which measures them."""
