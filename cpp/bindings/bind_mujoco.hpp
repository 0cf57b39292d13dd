/// Binding of the control loop over MuJoCo, kept apart from the controller's.
#pragma once

#include <nanobind/nanobind.h>

void bind_mujoco(nanobind::module_& m);
