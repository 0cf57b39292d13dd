// What runs the tests: Boost.Test's own sources, compiled once for all programs.
#define BOOST_TEST_MODULE dovetail
#include <boost/test/included/unit_test.hpp>
