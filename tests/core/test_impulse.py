"""Ideal impulses: the limit of ever shorter pulses, when they act, and that they add up."""

import numpy as np

import softpinch as sp


def test_an_impulse_is_the_limit_of_shorter_pulses() -> None:
    grasp = sp.simulate(sp.Scene(duration=0.5), dt=1e-4, every=10**9).state(-1)
    total, moment = np.array([0.02, -0.01]), 2e-4

    def end(disturbance: object) -> np.ndarray:
        scene = sp.Scene(initial=grasp, disturbances=[disturbance], duration=0.05)
        return np.asarray(sp.simulate(scene, dt=2e-5).q[-1])

    ideal = end(sp.Impulse(time=0.5, impulse=tuple(total), angular_impulse=moment))
    errors = []
    for duration in (8e-4, 4e-4, 2e-4, 1e-4):
        pulse = sp.Pulse(
            time=0.5, duration=duration, force=tuple(total / duration), moment=moment / duration
        )
        errors.append(np.abs(end(pulse) - ideal).max())
    ratios = np.array(errors[:-1]) / errors[1:]
    # A pulse acts half its length too late on average: first order.
    assert np.all(np.abs(ratios - 2) < 0.3), (errors, ratios)


def test_impulses_act_from_start_to_just_before_the_end() -> None:
    kick = {"impulse": (0.02, 0.0)}
    quiet = sp.simulate(sp.Scene(duration=0.02))
    late = sp.simulate(sp.Scene(duration=0.02, disturbances=[sp.Impulse(time=0.02, **kick)]))
    first = sp.simulate(sp.Scene(duration=0.02, disturbances=[sp.Impulse(time=0.0, **kick)]))
    np.testing.assert_array_equal(late.q, quiet.q)
    assert np.abs(first.p[1] - quiet.p[1]).max() > 1e-3
    # The row at the impulse's instant is the state just before it.
    np.testing.assert_array_equal(first.p[0], quiet.p[0])


def test_impulses_at_one_instant_add_up() -> None:
    one = sp.Impulse(time=0.01, impulse=(0.01, 0.02), angular_impulse=1e-4)
    two = sp.Impulse(time=0.01, impulse=(0.02, 0.04), angular_impulse=2e-4)
    twice = sp.simulate(sp.Scene(duration=0.02, disturbances=[one, one]))
    once = sp.simulate(sp.Scene(duration=0.02, disturbances=[two]))
    np.testing.assert_allclose(twice.q, once.q, rtol=0, atol=1e-14)
