/// Binding of the closed loop under attack, for benchmarks and tests.
#pragma once

#include <nanobind/nanobind.h>

void bind_attack(nanobind::module_& m);
