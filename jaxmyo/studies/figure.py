"""Contours of a study of the thin sample over a/D and T0."""

from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator

from jaxmyo.paper import style
from jaxmyo.studies.result import Study

#: Output, and what its panel says.
PANELS = {
    "lambda_f": "state A: stretch λf [–]",
    "lambda_cf": "state A: stretch λcf [–]",
    "lambda_n": "state A: stretch λn [–]",
    "T_cf": "state A: tension T_A^cf [kPa]",
    "sigma11": "state C: Cauchy stress σ11 [kPa]",
    "sigma22": "state C: Cauchy stress σ22 [kPa]",
}
LEVELS = 10


def contours(path: Path, name: str, found: Study, stretch: tuple[float, float]) -> Path:
    """Six panels over a/D and T0, of the largest beta of the study, as a PNG file; grey where a sample failed."""
    dataset, beta = found.values, found.design.fixed.get("beta")
    if beta is None:
        beta = float(found.axes["beta"].max())
        at = int(found.axes["beta"].argmax())
        dataset = {output: x[:, :, at] for output, x in dataset.items()}
    a_over_D, T0 = found.axes["a_over_D"], found.axes["T0"]
    figure, axes = style.figure(10.4, 6.6, 3, 2)
    for ax, (output, label) in zip(axes, PANELS.items(), strict=True):
        values = np.ma.masked_invalid(dataset[output].T)
        ax.set_facecolor("0.8")
        if values.count():
            levels = MaxNLocator(LEVELS).tick_values(values.min(), values.max())
            filled = ax.contourf(a_over_D, T0, values, levels=levels, cmap="viridis")
            ax.contour(a_over_D, T0, values, levels=levels, colors="white", linewidths=0.6)
            figure.colorbar(filled, ax=ax)
        unstable = dataset["negative_eigenvalues_A" if label.startswith("state A") else "negative_eigenvalues_C"].T > 0
        if unstable.any():
            ax.contourf(a_over_D, T0, unstable, levels=[0.5, 1.5], colors="none", hatches=["//"])
        ax.set_title(label)
        ax.set(xlabel="a/D [–]", ylabel="T0 [kPa]")
    figure.suptitle(
        f"Thin sample, β = {beta:g}, constants: {name}; A: free contraction; C: stretches {stretch[0]:g} along the "
        f"fibres, {stretch[1]:g} across",
        fontsize=11,
    )
    return style.save(figure, path)
