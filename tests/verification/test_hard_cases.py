"""The start of a hard case is random, but the same on any number of ranks."""

import numpy as np

from fabric_fenicsx.verification.hard_cases import noise


def test_noise_depends_on_places_alone():
    x = np.random.default_rng(2).uniform(-200, 200, (500, 3)).round(3)
    found = noise(x)
    assert np.abs(found).max() <= 0.5 and np.abs(found.mean(0)).max() < 0.05
    assert np.abs(np.corrcoef(found.T)[0, 1]) < 0.1 and found.std(0).min() > 0.25
    assert np.abs(noise(x[::-1] + 1e-13)[::-1] - found).max() < 1e-6
