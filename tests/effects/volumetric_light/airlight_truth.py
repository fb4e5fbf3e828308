"""Airlight integrals in decimal arithmetic of 40 digits, by the double exponential rule: the truth for stiff
media. Nothing here is shared with the kernels, not even the variable of integration."""

from __future__ import annotations

from decimal import Decimal, getcontext
from itertools import pairwise

getcontext().prec = 40
PI = Decimal("3.14159265358979323846264338327950288419716940")
HALF = Decimal("0.5")


def _sinh_cosh(x: Decimal) -> tuple[Decimal, Decimal]:
    grown = x.exp()
    return (grown - 1 / grown) / 2, (grown + 1 / grown) / 2


def _double_exponential(f, low: Decimal, high: Decimal, step: Decimal = Decimal("0.125")) -> Decimal:
    """Integral of a function that is smooth between the limits (Takahasi and Mori 1974)."""
    middle, half = (low + high) / 2, (high - low) / 2
    total, k = Decimal(0), 0
    while True:
        sinh, cosh = _sinh_cosh(step * k)
        arm, slope = _sinh_cosh(PI / 2 * sinh)[1], cosh * PI / 2
        away = _sinh_cosh(PI / 2 * sinh)[0] / arm
        weight = slope / (arm * arm)
        terms = f(middle + half * away) + (f(middle - half * away) if k else 0)
        total += weight * terms
        if weight < Decimal("1e-25"):
            return total * half * step
        k += 1


def point(height, tau0, tau1, extinction, anisotropy, radius, start=None) -> Decimal:
    """Integral over tau of exp(-extinction (tau - tau0 + travelled)) A(D) HG, per unit of intensity and of
    scattering, with D = sqrt(height^2 + tau^2), A = 2 / (q (q + D)), q = sqrt(D^2 + radius^2), and `start`
    metres travelled until tau0 (None: the distance from the light). HG's mean cosine is the anisotropy times
    that of the directions that the light fills. Cut into pieces a factor of e wide
    around the closest point and around the start, and at every e-fold of extinction."""
    h, a, b, sigma, g, r = (Decimal(float(x)) for x in (height, tau0, tau1, extinction, anisotropy, radius))

    def distance(tau):
        return (h * h + tau * tau).sqrt()

    first = distance(a)

    def f(tau):
        d = distance(tau)
        q = (d * d + r * r).sqrt()
        # Of a light that fills a cone of directions, the mean of their cosines to its middle.
        mean = g * (1 - r * r / (2 * q * (q + d)))
        m = 1 + mean * mean + 2 * mean * tau / d
        spent = (tau - a) + (d - first)
        return (-sigma * spent).exp() * 2 / (q * (q + d)) * (1 - mean * mean) / (4 * PI * m * m.sqrt())

    cuts = {a, b}
    sharp = h * (1 - abs(g)) / (1 + abs(g))
    scales = [h, r, sharp] + ([1 / sigma] if sigma else [])
    smallest = min(s for s in scales if s > 0)
    for centre in (Decimal(0), a):
        reach = smallest / 8
        while reach < abs(b - a) + abs(a) + abs(b):
            cuts |= {centre + reach, centre - reach}
            reach *= 2
        cuts.add(centre)
    ordered = sorted(cut for cut in cuts if a <= cut <= b)
    total = Decimal(0)
    for low, high in pairwise(ordered):
        spent = sigma * ((low - a) + (distance(low) - first))
        if spent < 90:
            total += _double_exponential(f, low, high)
    before = first if start is None else Decimal(float(start))
    return total * (-sigma * before).exp()


def sun(length, extinction) -> Decimal:
    """(1 - exp(-extinction length)) / extinction."""
    sigma, d = Decimal(float(extinction)), Decimal(float(length))
    return (1 - (-sigma * d).exp()) / sigma if sigma else d
