"""A made-up aircraft whose derivatives are known, for what identifies them."""

from __future__ import annotations

from tgl_soar.analysis.identification import KnownAircraft

GRAVITY_MPS2 = 9.80665
BODY = KnownAircraft(
    mass_kg=0.7,
    wing_area_m2=0.18,
    chord_m=0.16,
    iyy_kgm2=0.02,
    air_density_kgpm3=1.2,
    servo_lag_radps=30.0,
    servo_rate_per_s=8.0,
)
TRUE = {
    "CL0": 0.35,
    "CL_alpha": 5.0,
    "CL_elevator": -0.12,
    "Cm0": 0.02,
    "Cm_alpha": -0.5,
    "Cm_q": -9.0,
    "Cm_elevator": 0.3,
    "delay": 0.033,
    "CL_brake": -0.2,
    "Cm_brake": 0.05,
}
