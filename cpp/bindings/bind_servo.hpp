/// Binding of the servo loop and its parts.
#pragma once

#include <nanobind/nanobind.h>

void bind_servo(nanobind::module_& m);
