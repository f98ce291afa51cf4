"""Figures 1 to 4 of the paper's case study, drawn from the runs of `paper_planar.py`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import PowerNorm
from matplotlib.figure import Figure
from planar_case import OLS, PAPER, TORQUE_NOISE, Array, Case, Run, arm, history_steps

LIMITS = (3.0, 5.0, 10.0)
STYLE = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "legend.frameon": False,
    "lines.linewidth": 1.0,
}
BLUE, RED, GREY = "#2b6cb0", "#c53030", "#555555"
SHOWN = 20.0  # seconds of torque drawn


def draw(case: Case, runs: dict[float, list[Run]], folder: Path, draws: int) -> list[Path]:
    """Write the four pictures, Figure 2 from some draws of noise; returns their paths."""
    folder.mkdir(parents=True, exist_ok=True)
    least = min(runs)
    with mpl.rc_context(STYLE):
        figures = {
            "figure1_motion.png": motion(case),
            "figure2_noise.png": noise(case, draws),
            "figure3_bounds.png": bounds(case, runs[least], least),
            "figure4_torque.png": torque(case, runs),
        }
        for name, figure in figures.items():
            figure.savefig(folder / name, dpi=110)
    return [folder / name for name in figures]


def motion(case: Case) -> Figure:
    """Figure 1: the motion, the points it was planned at, and the limits."""
    figure = Figure(figsize=(10, 6), layout="constrained")
    axes = figure.subplots(3, 2, sharex=True, sharey="row")
    seconds, *points = case.points
    labels = ("position, rad", "velocity, rad/s", "acceleration, rad/s²")
    for row, (curve, dots, limit) in enumerate(zip((case.q, case.v, case.a), points, LIMITS, strict=True)):
        for j, ax in enumerate(axes[row]):
            ax.axhspan(-limit, limit, color="#e8f0e4", lw=0)
            ax.plot(case.t, curve[:, j], color=BLUE, lw=0.7)
            ax.plot(seconds, dots[:, j], ".", color="black", ms=3)
        axes[row, 0].set_ylabel(labels[row])
    for j, ax in enumerate(axes[0]):
        ax.set_title(f"joint {j + 1}")
    for ax in axes[-1]:
        ax.set_xlabel("time, s")
        ax.set_xlim(0, case.t[-1])
    figure.suptitle(f"Figure 1: {case.source}; dots once a second, shaded: the limits the points keep", fontsize=10)
    return figure


def noise(case: Case, draws: int) -> Figure:
    """Figure 2: what noise on q, q̇, q̈ does to the columns, and the singular values."""
    figure = Figure(figsize=(11, 3.8), layout="constrained")
    axes = figure.subplots(1, 3, width_ratios=(1, 1, 1.15))
    rng = np.random.default_rng(0)
    seconds, *points = case.points
    anywhere = [rng.uniform(-limit, limit, x.shape) for x, limit in zip(points, LIMITS, strict=True)]
    covariances = [_off_diagonal(seconds, states, rng, draws) for states in (points, anywhere)]
    top = max(S.max() for S in covariances)
    ticks = range(len(arm().names))
    for ax, S, title in zip(axes, covariances, ("at the exciting points", "at random points"), strict=False):
        image = ax.imshow(S, cmap="viridis", norm=PowerNorm(0.4, 0.0, top))
        ax.set_xticks(ticks, arm().names, rotation=60)
        ax.set_yticks(ticks, arm().names)
        ax.set_title(f"{title}: ψ = {S.sum(axis=1).max():.1f}")
        ax.spines[:].set_visible(True)
    figure.colorbar(image, ax=axes[:2], shrink=0.8, label="|off-diagonal|")
    for states, color, label in ((points, BLUE, "exciting points"), (anywhere, RED, "random points")):
        values = np.linalg.svd(arm().rows(seconds, *states), compute_uv=False)
        label = f"{label}, cond {values[0] / values[-1]:.1f}"
        axes[2].semilogy(np.arange(1, len(values) + 1), values, "o-", color=color, ms=4, label=label)
    axes[2].set_title("singular values of the base regressor")
    axes[2].set_xlabel("number")
    axes[2].legend()
    figure.suptitle(
        "Figure 2: covariance of the regressor's columns under unit noise on q, q̇, q̈, off-diagonal, mean of "
        f"{draws} draws",
        fontsize=10,
    )
    return figure


def _off_diagonal(t: Array, states: list[Array], rng: np.random.Generator, draws: int) -> Array:
    """Absolute off-diagonal of the covariance that unit noise gives the columns, as in cost (19)."""
    still = arm().rows(t, *states)
    S = np.zeros((still.shape[1],) * 2)
    for _ in range(draws):
        moved = arm().rows(t, *(x + rng.normal(size=x.shape) for x in states)) - still
        S += moved.T @ moved / len(moved) / draws
    return np.abs(S - np.diag(S.diagonal()))


def bounds(case: Case, runs: list[Run], sigma: float) -> Figure:
    """Figure 3: the bounds of the authors' recursion as the window slides, over all runs."""
    figure = Figure(figsize=(11, 8), layout="constrained")
    axes = figure.subplots(3, 3, sharex=True)
    steps = history_steps(len(case.t)) + 1
    for i, ax in enumerate(axes.flat):
        for name, color in (("lower", BLUE), ("upper", RED)):
            curves = np.array([getattr(run, name)[:, i] for run in runs])
            curves[~np.isfinite(curves)] = np.nan
            ax.fill_between(steps, np.nanmin(curves, axis=0), np.nanmax(curves, axis=0), color=color, alpha=0.2, lw=0)
            ax.plot(steps, np.nanmean(curves, axis=0), color=color, lw=1.5, label=f"{name} bound")
        ax.axhline(arm().theta[i], color="black", ls="--", label="true value")
        ax.set_xscale("log")
        ax.set_title(f"{arm().expressions[i]}\nright in {_right(runs, i):.0f} % of the runs at the end")
    axes[0, 0].legend()
    for ax in axes[-1]:
        ax.set_xlabel("window")
    figure.suptitle(
        f"Figure 3: bounds of BBRF as published, σ_q = {sigma:g}, {len(runs)} runs, none discarded "
        "(mean, and from smallest to largest)",
        fontsize=10,
    )
    return figure


def _right(runs: list[Run], i: int) -> float:
    theta = arm().theta[i]
    return float(100 * np.mean([run.lower[-1, i] <= theta <= run.upper[-1, i] for run in runs]))


def torque(case: Case, runs: dict[float, list[Run]]) -> Figure:
    """Figure 4: torque and what the identified models make of it."""
    figure = Figure(figsize=(10, 7.5), layout="constrained")
    axes = figure.subplots(4, 1, height_ratios=(1.2, 1.2, 1, 1))
    W, (least, most) = arm().rows(case.t, case.q, case.v, case.a), (min(runs), max(runs))
    J = case.q.shape[1]
    true = case.tau.reshape(-1, J)
    part = case.t <= SHOWN
    for j in range(J):
        theta = np.array([run.estimates[PAPER] for run in runs[most]])
        predicted = (theta @ W.T).reshape(len(theta), -1, J)[:, part, j]
        axes[j].plot(case.t[part], true[part, j], color="black", lw=2.2, label="noise-free")
        axes[j].plot(case.t[part], predicted.mean(axis=0), "--", color=RED, label=f"paper, σ_q = {most:g}")
        axes[j].set_ylabel(f"torque {j + 1}, N·m")
        axes[j].set_xlim(0, SHOWN)
    _legend_above(axes[0])
    for ax, sigma in zip(axes[J:], (least, most), strict=True):
        _error_norms(ax, case, W, runs[sigma])
        ax.set_title(f"norm of the error, N·m, σ_q = {sigma:g}: mean and largest of {len(runs[sigma])} runs")
    axes[-1].set_xlabel("time, s")
    figure.suptitle(
        f"Figure 4: torque of the noise-free motion (the measured one has noise of {TORQUE_NOISE:g} N·m)", fontsize=10
    )
    return figure


def _error_norms(ax: Any, case: Case, W: Array, runs: list[Run]) -> None:
    for name, color in ((PAPER, RED), (OLS, BLUE)):
        error = np.array([run.estimates[name] for run in runs]) - arm().theta
        norms = np.linalg.norm((error @ W.T).reshape(len(runs), len(case.t), -1), axis=2)
        ax.fill_between(case.t, 0, norms.max(axis=0), color=color, alpha=0.25, lw=0)
        ax.plot(case.t, norms.mean(axis=0), color=color, label=name, lw=0.8)
    ax.set_xlim(0, case.t[-1])
    ax.set_ylim(bottom=0)
    _legend_above(ax)


def _legend_above(ax: Any) -> None:
    ax.legend(ncols=2, loc="lower right", bbox_to_anchor=(1.0, 0.97), borderaxespad=0.0)
