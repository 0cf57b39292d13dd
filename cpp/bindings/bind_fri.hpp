/// Binding of the FRI codec, for the simulated cabinet and for tests.
#pragma once

#include <nanobind/nanobind.h>

void bind_fri(nanobind::module_& m);
