"""What every other part uses: messages, specs, errors, geometry, randomness, kernels, files."""
