/// Binding of what a policy step takes from a log of control cycles.
#pragma once

#include <nanobind/nanobind.h>

void bind_cycle_log(nanobind::module_& m);
