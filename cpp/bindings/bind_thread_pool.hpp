/// Binding of the pool that runs many control loops at once.
#pragma once

#include <nanobind/nanobind.h>

void bind_thread_pool(nanobind::module_& m);
