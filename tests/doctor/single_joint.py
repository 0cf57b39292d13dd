"""One joint with a delay, friction and springs, integrated finer than it is seen."""

import numpy as np

SUBSTEPS = 100


def move(
    *,
    period,
    delay,
    cycles=2000,
    inertia=1.0,
    damping=0.0,
    coulomb=0.0,
    stiffness=0.0,
    spring=0.0,
    gravity=0.0,
    lean=None,
    noise=0.0,
    seed=0,
):
    """Push the joint to and fro about 0; return its cycle log's q and tau, (n, 7).

    A hidden controller (a PD law with random targets) makes the torques, as on an arm.
    Torque and lean act after the delay.
    """
    rng = np.random.default_rng(seed)
    fine = period / SUBSTEPS
    late = round(delay / fine)
    sent = np.zeros(cycles * SUBSTEPS + late + 1)
    sent[:] = gravity
    leaned = np.zeros(len(sent))
    q, dq, target, left = 0.0, 0.0, 0.025, 0
    qs, taus = np.empty(cycles), np.empty(cycles)
    for i in range(cycles):
        if left <= 0.0:
            target, left = -target, 0.02 * rng.integers(1, 5)
        left -= period
        qs[i] = q + noise * rng.standard_normal()
        taus[i] = inertia * (200.0 * (target - q) - 28.0 * dq) + gravity
        sent[i * SUBSTEPS + late : (i + 1) * SUBSTEPS + late] = taus[i]
        if lean is not None:
            leaned[i * SUBSTEPS + late : (i + 1) * SUBSTEPS + late] = lean[i]
        for k in range(i * SUBSTEPS, (i + 1) * SUBSTEPS):
            pull = damping * dq + coulomb * np.tanh(dq / 0.005) + stiffness * q
            ddq = (sent[k] - gravity - pull + spring * leaned[k]) / inertia
            q += fine * dq + 0.5 * fine**2 * ddq
            dq += fine * ddq
    return _seven(qs), _seven(taus)


def _seven(values):
    columns = np.zeros((len(values), 7))
    columns[:, 0] = values
    return columns
