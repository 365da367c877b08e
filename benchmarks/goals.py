"""The goals of performance and how results are judged by them.

A goal is a sentence, the part or the key of a part that it needs, and a function of the results by
part. The function returns what was measured, whether that is enough, and what limits it if not.
"""

FMA_LEAST = 1.9  # gain of multiply-add by a second thread below which scaling tells nothing


def zone_roof(r):
    """Judge the damped full step by the roof of the least data."""
    one = r["kernels"]["1 M"]
    least, own = one["share_of_least_roof"]["damped_1"], one["share_of_own_roof"]["damped_1"]
    bare = one["share_of_least_roof"]["zones_1"]
    words = f"{own:.2f} of the limit of its own bytes, {least:.2f} of that of 59 B"
    return words, own >= 0.30, f"zones alone reach {bare:.2f} of the limit of 59 B"


def naive(r):
    """Judge the damped full step by the naive loop."""
    over = r["kernels"]["1 M"]["over_naive"]
    words = f"{over['damped_1']:.2f} damped, {over['step_1']:.2f} undamped"
    why = f"zones alone {over['zones_1']:.2f}; the loop has no damping; where edges carry the "
    why += f"ground {over['edges_damped_1']:.2f} damped, {over['edges_1']:.2f} undamped"
    return words, over["damped_1"] >= 1.4, why


def edges(r):
    """Judge the full step by edges, without damping and with it."""
    one = r["kernels"]["1 M"]
    still, damped = (one["share_of_own_roof"][f"{name}_1"] for name in ("edges", "edges_damped"))
    over = one["edges_over_zones"]
    words = f"{still:.2f} of its limit, {over['step']:.2f} × zones; "
    words += f"damped {damped:.2f}, {over['damped']:.2f} ×"
    reached = min(still, damped) >= 0.60 and min(over.values()) >= 1.4
    small = r["kernels"]["0.2 M"]["edges_over_zones"]["step"]
    why = f"memory; nodes and slots take about half of it either way: {small:.2f} × at 0.2 "
    return words, reached, why + "million zones, which the cache holds"


def peers(r):
    """Judge the peers that ran."""
    wanted = {"Akantu": 25.0, "Kratos": 60.0, "OpenSeesPy": 120.0, "NGSolve": 1.5, "MFEM": 1.5}
    found = {n: one.get("ours_over_theirs") for n, one in r["peers"]["peers"].items()}
    words = ", ".join(f"{n} {x:.1f}" if x else f"{n} failed" for n, x in found.items())
    least = [n for n, x in found.items() if x is not None and x < wanted[n]]
    busy = [n for n, one in r["peers"]["peers"].items() if one.get("beside_other_work")]
    words += f"; beside other work: {', '.join(busy)}" if busy else ""
    short = ", ".join(f"{n} below {wanted[n]:g}" for n in least)
    return words, bool(found) and all(found.values()) and not least, short


def batch(r):
    """Judge batches of zones."""
    one = r["kernels"]["1 M"]["batch_of_8"]
    words = f"{one['step_1']:.2f} and {one['step_2']:.2f} (1, 2 threads)"
    words += f", damped {one['damped_1']:.2f}"
    why = "damped, each model of a batch stores and moves its own low-passed velocities"
    return words, min(one["step_1"], one["step_2"], one["damped_1"]) >= 1.6, why


def batch_edges(r):
    """Judge batches of edges."""
    one, size = r["kernels"]["1 M"]["batch_of_8"], r["kernels"]["1 M"]["bytes_per_zone"]
    words = f"{one['edges_1']:.2f} and {one['edges_2']:.2f} (1, 2 threads)"
    words += f", damped {one['edges_damped_1']:.2f}"
    own = 56.0 * size["slots_a_zone"] + 212.0 * size["nodes_a_zone"]
    lane = own + (size["edges"] - own) / 8.0
    why = f"a model of a batch moves {lane:.0f} B a zone of the {size['edges']:.0f} B of a single "
    why += f"run: {size['edges'] / lane:.2f} × at the same share of the limit"
    return words, min(one["edges_1"], one["edges_2"]) >= 2.3, why


def armed(r):
    """Judge ground that may yield and does not."""
    one, zones = (r["laws"][over]["Mohr-Coulomb, not yielding"] for over in ("single", "by zones"))
    why = "volumetric patches beside edges; check of displacements; energies by zones"
    return f"{one:.2f} × over edges, {zones:.2f} × over zones", one <= 1.1, why


def joints(r):
    """Judge joints."""
    one, zones = r["laws"]["single"], r["laws"]["by zones"]
    words = f"elastic {one['elastic joints']:.2f} ×, coulomb {one['coulomb joints']:.2f} × over "
    words += f"edges; {zones['elastic joints']:.2f} ×, {zones['coulomb joints']:.2f} × over zones"
    facets = r["laws"]["facets_a_zone"]
    why = f"{facets:.2f} facets a zone; there are more edges, nearly half with a skew part, and "
    why += "more nodes; contacts themselves are a seventh of the step"
    return words, one["coulomb joints"] <= 1.25, why


def two_threads(r):
    """Judge the second thread, where the machine has one."""
    one = r["kernels"]["1 M"]
    fma, both = one["probes"]["multiply_add_two_threads"], one["two_threads"]
    gained = min(both["step"], both["edges"])
    words = f"zones {both['step']:.2f} ×, edges {both['edges']:.2f} ×, multiply-add {fma:.2f} ×"
    if fma < FMA_LEAST:
        return words, False, "not judged: multiply-add gains less than 1.9 on this machine"
    why = f"the stream itself gains {one['probes']['triad_two_threads']:.2f}"
    return words, gained >= 1.8, why


def order(r):
    """Judge input in random order."""
    one = r["kernels"]["1 M"]
    words = f"{one['random_over_ordered']:.2f} ×; without renumbering "
    return words + f"{one['unordered_over_ordered']:.2f} ×", one["random_over_ordered"] >= 0.95, ""


def implicit_zones(r):
    """Judge implicit zones on the blocky test."""
    builds = list(r["steps"]["builds"].values())
    gained = builds[-1]["implicit_dt_ms"] / builds[0]["dt_ms"]
    return f"{gained:.0f} ×", gained >= 20.0, ""


def damping(r):
    """Judge what low-passed damping leaves of the step."""
    one = r["steps"]["low_passed"]
    words = f"{one['low-passed']:.2f} × (lagged {one['lagged']:.2f} ×)"
    return words, one["low-passed"] >= 0.75, ""


def mine(r):
    """Judge the mine."""
    one = r["mine"]["at 5 m"]
    low, lagged = (one["damping"][kind] for kind in ("low-passed", "lagged"))
    static = one["static"]["seconds"]
    whole = low["seconds_for_the_motion"][1] + static
    words = (
        f"{low['seconds_for_the_motion'][1]:.0f} s low-passed, "
        f"{lagged['seconds_for_the_motion'][1]:.0f} s lagged, 2 threads; static {static:.0f} s"
    )
    limit = low["limited_by"].split(" at ")[0]
    rate = 1e9 * low["seconds_a_step"][1] / one["zones"]
    why = (
        f"{low['steps']} steps of {low['dt_ms']:.3f} ms, set by {limit}; {rate:.0f} ns for each of "
    )
    why += (
        f"{one['zones'] / 1e6:.2f} million zones with {one['contacts'] / one['zones']:.1f} contacts"
    )
    return words, whole <= 120.0, why


def case(r):
    """Judge a site at the mesh that carries its highest frequency."""
    each = {name: one["seconds_a_blast_in_batch"] for name, one in r["case"].items()}
    words = ", ".join(f"{name} {seconds:.2f} s" for name, seconds in each.items())
    return words, min(each.values()) <= 5.0, "quadratic zones gain nothing from a batch"


def at_most(need, most, unit):
    """Return a goal's key and the function that judges it by a largest value."""
    part, key = need.split(".")

    def judge(results):
        """Judge one number of the results."""
        value = results[part][key]
        return f"{value:.3g} {unit}", value <= most, ""

    return need, judge


GOALS = (
    ("`./dev demo` on a fresh machine ≤ 3 min", *at_most("demo.seconds", 180.0, "s")),
    (
        "site of a quarry (case-04, S1), file to report ≤ 5 s",
        *at_most("site.file_to_report_s", 5.0, "s"),
    ),
    ("site: its run ≤ 1.5 s", *at_most("site.march_s", 1.5, "s")),
    (
        "site: energy of the difference from an independent program ≤ 1 %",
        *at_most("site.error", 0.01, "of the energy"),
    ),
    ("mine at 5 m, file to report ≤ 3 min", *at_most("mine.file_to_report_s", 180.0, "s")),
    ("`./dev test` ≤ 6 min", *at_most("tests.seconds", 360.0, "s")),
    ("check of any example ≤ 10 s", *at_most("check.slowest_s", 10.0, "s")),
    ("general zone step ≥ 0.30 of its memory limit, 1 M zones, full step", "kernels", zone_roof),
    ("≥ 1.4 × a naive element loop", "kernels", naive),
    ("elastic edge step ≥ 0.60 of its limit and ≥ 1.4 × the general one", "kernels", edges),
    (
        "≥ 25 × Akantu, 60 × Kratos, 120 × OpenSeesPy, 1.5 × NGSolve or MFEM, 1 thread",
        "peers",
        peers,
    ),
    ("batch of 8 ≥ 1.6 × single runs (zones)", "kernels", batch),
    ("batch of 8 ≥ 2.3 × single runs (edges)", "kernels", batch_edges),
    ("yielding ground that does not yield ≤ 1.1 ×", "laws", armed),
    ("joints at 0.2 facets a zone ≤ 1.25 ×", "laws", joints),
    ("2 threads ≥ 1.8 × where multiply-add gains ≥ 1.9 ×", "kernels", two_threads),
    ("random input order ≥ 0.95 × ordered, after set-up", "kernels", order),
    ("implicit zones: step ≥ 20 × raw on the blocky test", "steps", implicit_zones),
    ("low-passed damping of 5 % keeps ≥ 0.75 × the undamped step", "steps", damping),
    ("mine at 5 m, 2 s of motion ≤ 120 s", "mine", mine),
    ("a case at the mesh of its 30 Hz: ≤ 5 s a blast in a batch", "case", case),
)
