/// Binding of the limits' pure functions, for tests and for studying them.
#pragma once

#include <nanobind/nanobind.h>

void bind_limits(nanobind::module_& m);
