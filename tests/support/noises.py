"""Held noise that several tests share."""

import numpy as np

import softpinch as sp


def noise(**changes: object) -> sp.Noise:
    fields = {"force_std": (2.0, 0.5), "moment_std": 0.01, "rate_hz": 250.0, "seed": 12, "run": 7}
    return sp.Noise(**{**fields, **changes})


def held(one: sp.Noise, place: int, until: float) -> sp.Sampled:
    """The same forces as samples from a file."""
    count = max(1, int(np.ceil((until - one.time) * one.rate_hz)))
    times = one.time + np.arange(count) / one.rate_hz
    loads = one.samples(count, place)
    if one.duration is not None:
        kept = times < one.time + one.duration
        times = np.append(times[kept], one.time + one.duration)
        loads = np.vstack([loads[kept], np.zeros(3)])
    return sp.Sampled(times=times, force=loads[:, :2], moment=loads[:, 2], hold="zero")


AWKWARD = [
    noise(),
    noise(rate_hz=333.3, time=0.0123),
    noise(rate_hz=1234.5, time=0.001, duration=0.0301),
    noise(rate_hz=90.0, time=-0.0457),
    noise(rate_hz=10.0, time=0.033, duration=0.001),
]
