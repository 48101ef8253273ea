"""Claims on the constraint torques and the order of events: Secs. III, VI and VII, Figs. 2 and 3, Eq. (1)."""

from __future__ import annotations

from ..evidence import Evidence, Row, Values
from ..results import Quantity
from ..throws.third_constraint import PREFIX
from ..verdicts import Cause, Judgement, at_least, positive, vanishes

_HANGER, _SLING = "hanger rest", "sling rest"
_ROUGHLY = "'roughly' asks that the curve accounts for 99 % of the variance"
_FIT = 0.99
_SIGNIFICANT = 0.1


def rows(evidence: Evidence) -> list[Row]:
    """All of them."""
    return [*_order(evidence), *_shapes(), *_signs(), *_rigid(evidence), *_third(evidence)]


def _order(evidence: Evidence) -> list[Row]:
    found = [
        Row(
            f"hanger released first, {name}",
            where,
            "λ, then γ",
            "sling's release less hanger's",
            "s",
            lambda f, name=name: f[f"{name}: release_time ({_SLING})"] - f[f"{name}: release_time ({_HANGER})"],
            lambda q: positive(q, "the time from the hanger's release to the sling's"),
            name,
        )
        for name, where in (("fixed", "Sec. III"), ("rolling", "Sec. VI"))
    ]
    return [*found, *(_pairing(evidence, each) for each in ("fixed", "rolling"))]


def _pairing(evidence: Evidence, name: str) -> Row:
    """By Eq. (1) lambda is the multiplier of G1, by Eq. (6) that of the sling's angle: then it is the sling's."""
    where = {"fixed": "Eqs. (1), (6), (7)", "rolling": "Sec. VI"}[name]
    printed = {"fixed": "λ with G1", "rolling": "G2 kept"}[name]
    return Row(
        f"which multiplier vanishes first, {name}",
        where,
        printed,
        "release of G2 (hanger) less that of G1 (sling)",
        "s",
        lambda f: f[f"{name}: release_time ({_HANGER})"] - f[f"{name}: release_time ({_SLING})"],
        lambda q: positive(
            q, "the time from the release of G1 (λ's by Eq. (1)) to that of G2", [_swapped(evidence, name)]
        ),
        name,
    )


def _swapped(evidence: Evidence, name: str) -> Cause:
    first = evidence.ours[f"{name}: release_time ({_HANGER})"]
    return Cause(
        first < evidence.ours[f"{name}: release_time ({_SLING})"],
        f"the hanger's multiplier, which Eqs. (1) and (7) call γ, is zero first, at {first:.4g} s; with the symbols "
        "the other way round, as in Figs. 2 and 3, all agrees",
    )


def _shapes() -> list[Row]:
    def parabola(stop: str) -> Row:
        symbol, figure = ("λ", "Fig. 2") if stop == _HANGER else ("γ", "Fig. 3")
        return Row(
            f"{symbol} like a parabola",
            f"Sec. III, {figure}",
            "quadratic",
            "R² of a parabola through the torque while both rests push",
            "",
            lambda f: f[f"fixed: parabola ({stop})"],
            lambda q: at_least(q, _FIT, _ROUGHLY),
            "fixed",
        )

    return [
        parabola(_HANGER),
        _falling(_HANGER),
        parabola(_SLING),
        _falling(_SLING),
        Row(
            "γ nearly linear after λ is gone",
            "Sec. III, Fig. 3",
            "linear",
            "R² of a line through the sling's torque between the releases",
            "",
            lambda f: f[f"fixed: line ({_SLING})"],
            lambda q: at_least(q, _FIT, _ROUGHLY),
            "fixed",
        ),
        Row(
            "constraints depend on each other",
            "Secs. III, VII",
            "> 0",
            "change of the slope of γ where λ is gone, of its slope before",
            "",
            lambda f: f[f"fixed: slope change ({_SLING})"],
            lambda q: at_least(q, _SIGNIFICANT, "'significantly' asks for a tenth"),
            "fixed",
        ),
        Row(
            "projectile freed sooner by the counterweight's swing",
            "Sec. III, Fig. 3",
            "> 1",
            "slope of γ once λ is gone, over its slope before",
            "",
            lambda f: f[f"fixed: steepening ({_SLING})"],
            lambda q: at_least(q, 1 + _SIGNIFICANT, "quicker by a tenth"),
            "fixed",
        ),
    ]


def _falling(stop: str) -> Row:
    name, figure, printed = (
        ("λ only falls", "Fig. 2", "decreasing") if stop == _HANGER else ("γ only rises", "Fig. 3", "increasing")
    )
    return Row(
        name,
        f"Sec. III, {figure}",
        printed,
        f"largest growth of the {stop.split(maxsplit=1)[0]}'s torque before the first release, of its start",
        "",
        lambda f: f[f"fixed: climb ({stop})"],
        lambda q: vanishes(q, 0.0, "a torque that fades does not grow"),
        "fixed",
    )


def _signs() -> list[Row]:
    # Stops' torques here push their gaps open; in the paper's L = T - U + lambda G the hanger's multiplier, of
    # theta - alpha, has the same sign, and the sling's, of theta - phi, the opposite one.
    def row(symbol: str, name: str, printed: str, quantity: str, sign: int) -> Row:
        stop = _HANGER if symbol == "λ" else _SLING
        return Row(
            f"{symbol} at the start, {name}",
            "Sec. III, Fig. " + ("2" if symbol == "λ" else "3"),
            printed,
            quantity,
            "N m",
            lambda f: sign * f[f"{name}: stop_torque ({stop}), start"],
            lambda q: positive(_turned(q, sign), f"{'' if sign > 0 else 'minus '}the multiplier"),
            name,
        )

    return [
        row("λ", "fixed", "> 0", "hanger's multiplier at the start, in the paper's sign", 1),
        row("γ", "fixed", "< 0", "sling's multiplier at the start, in the paper's sign", -1),
        row("λ", "rolling", "> 0", "hanger's multiplier at the start, in the paper's sign", 1),
        row("γ", "rolling", "< 0", "sling's multiplier at the start, in the paper's sign", -1),
    ]


def _turned(q: Quantity, sign: int) -> Quantity:
    return Quantity(value=sign * q.value, uncertainty=q.uncertainty, unit=q.unit)


def _rigid(evidence: Evidence) -> list[Row]:
    rounding = 64 * 2.2e-16 * 10  # of angles up to ten radians

    def judge(q: Quantity) -> Judgement:
        return vanishes(q, rounding, "rounding of angles")

    return [
        Row(
            f"one rigid mass at first, {name}",
            "Sec. III",
            "rigid",
            "largest bend at the two rests before the first release",
            "rad",
            lambda f, name=name: f[f"{name}: bend before the first release"],
            judge,
            name,
        )
        for name in evidence.throws
    ]


def _third(evidence: Evidence) -> list[Row]:
    found: list[Row] = []
    for name in evidence.throws:
        found += [
            Row(
                f"launched before the arm is upright, {name}",
                "Sec. III",
                "> 0",
                "arm at 3π/2 less launch",
                "s",
                lambda f, name=name: f[f"{name}: arm at its stop after launch"],
                lambda q: positive(q, "the time from the launch to the arm's arrival"),
                name,
            ),
            Row(
                f"arm stop acts after the launch, {name}",
                "Sec. III",
                "> 0",
                "first blow on a stop that acts, less launch",
                "s",
                lambda f, name=name: f[f"{name}: {PREFIX} arm stop acts"] - f[f"{name}: {PREFIX} launch_time"],
                lambda q: positive(q, "the time from the launch to the blow"),
                name,
            ),
            Row(
                f"third constraint leaves the launch alone, {name}",
                "Sec. III",
                "0",
                "launch speed with an arm stop that acts, less that without",
                "m/s",
                lambda f, name=name: _difference(f, name, "launch_speed"),
                lambda q: vanishes(q, 0.0, "the same launch"),
                name,
            ),
            Row(
                f"third constraint leaves the range alone, {name}",
                "Sec. III",
                "0",
                "range at 45 deg with an arm stop that acts, less that without",
                "m",
                lambda f, name=name: _difference(f, name, "range, launch"),
                lambda q: vanishes(q, 0.0, "the same launch"),
                name,
            ),
        ]
    return found


def _difference(f: Values, name: str, figure: str) -> float:
    return f[f"{name}: {PREFIX} {figure}"] - f[f"{name}: {figure}"]
