/// Binds the kinematic chain.
#pragma once

#include <nanobind/nanobind.h>

void bind_chain(nanobind::module_& m);
