/// Binding of the replay of recorded cycles.
#pragma once

#include <nanobind/nanobind.h>

void bind_replay(nanobind::module_& m);
