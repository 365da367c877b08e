"""T7: three fractures in a press; whether the closure law is named.

Hidden from the tool: that closure is nonlinear (its reference is a line), and one specimen in turn.
Control: the same closures with stress put back on each specimen's own line, with the same scatter
beside the hyperbola. Argument: the folder.
"""

import numpy as np
from closure_law import closure_law, fit_hyperbola, hyperbola
from keeper import Sealed, folder_of_recordings, keep


def specimens(folder):
    """Return closure [m] and stress [Pa] while loading, by specimen."""
    table = np.genfromtxt(folder / "joint_closure" / "granodiorite_closure.csv", delimiter=",",
                          names=True, dtype=None, encoding="utf-8")  # fmt: skip
    loading = table[table["step"] <= 13]
    return {name: (1e-3 * part["closure_mm"], 1e6 * part["normal_stress_mpa"])
            for name in np.unique(loading["specimen"])
            for part in [loading[loading["specimen"] == name]]}  # fmt: skip


def straightened(pairs):
    """Put the stress of each specimen on its best line, with its scatter beside the hyperbola."""
    return [(u, np.polyval(np.polyfit(u, s, 1), u) + s - hyperbola(fit_hyperbola([(u, s)]), u))
            for u, s in pairs]  # fmt: skip


def main():
    """Run the test and keep its rows."""
    known, rows = specimens(folder_of_recordings()), {}
    for name, (closure, stress) in known.items():
        own = fit_hyperbola([(closure, stress)])
        truth = {"law": "joint_nonlinear_closure", "kni": own[0], "vm": own[1],
                 "stress": stress.tolist()}  # fmt: skip
        sealed = Sealed(f"all but {name}", truth)
        others = [pair for other, pair in known.items() if other != name]
        said = closure_law(*zip(*others, strict=True))
        sealed.answered([said])
        opened, p = sealed.opened(), said.parameters
        closure, stress = (np.concatenate(x) for x in zip(*others, strict=True))
        line = np.polyfit(closure, stress, 1)
        bent = fit_hyperbola(others)
        left = [float(np.sqrt(np.mean((guess - opened["stress"]) ** 2)))
                for guess in (np.polyval(line, closure), hyperbola(bent, closure))]  # fmt: skip
        inside = {k: p[k][1] <= opened[k] <= p[k][2] for k in ("kni", "vm")} if p else {}
        rows[f"without {name}"] = sealed.scored(
            said.outcome == "NAMED" and left[1] < left[0], misfit_line_pa=left[0],
            misfit_hyperbola_pa=left[1], inside_90=inside,
        )  # fmt: skip
    sealed = Sealed("straightened", {"law": "linear"})
    said = closure_law(*zip(*straightened(list(known.values())), strict=True))
    sealed.answered([said])
    rows["control: straightened"] = sealed.scored(said.outcome == "NULL")
    keep("T7", rows)


if __name__ == "__main__":
    main()
