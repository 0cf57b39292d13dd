#include "dovetail/cycle_log.hpp"

#include <Eigen/Geometry>
#include <cmath>

namespace dovetail {
namespace {

constexpr int kForceColumn = column_at(offsetof(CycleRow, contact_force));
constexpr int kFlagsColumn = column_at(offsetof(CycleRow, flags));
constexpr int kWrenchColumn = column_at(offsetof(CycleRow, wrench_force));

}  // namespace

Vec4 quat_wxyz(const Mat3& R) noexcept {
  const Eigen::Quaterniond q(R);
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;
  return sign * Vec4(q.w(), q.x(), q.y(), q.z());
}

StepSummary summarize(const Chain& chain, const Vec7& q, const Vec7& dq,
                      const double* rows, int count) noexcept {
  ToolMotion tool;
  chain.tool_motion(q, dq, tool);
  StepSummary step{tool.p,       quat_wxyz(tool.R), tool.twist,
                   Vec3::Zero(), Vec6::Zero(),      0};
  if (count > 0) {
    const double* last = rows + static_cast<std::ptrdiff_t>(count - 1) * kCycleColumns;
    step.wrench = Eigen::Map<const Vec6>(last + kWrenchColumn);
  }
  double largest = -1.0;
  for (int i = 0; i < count; ++i, rows += kCycleColumns) {
    const Eigen::Map<const Vec3> force(rows + kForceColumn);
    const double size = force.squaredNorm();
    if (size > largest || std::isnan(size)) {  // nan: the arm cannot measure it
      largest = size;
      step.force = force;
    }
    step.flags |= static_cast<std::int64_t>(rows[kFlagsColumn]);
  }
  return step;
}

int count_outside(const double* rows, int count, const double* low,
                  const double* high) noexcept {
  int outside = 0;
  for (int i = 0; i < count; ++i, rows += kCycleColumns) {
    int crossed = 0;  // no early exit, so that the columns go side by side
    for (int j = 0; j < kCycleColumns; ++j) {
      crossed |=
          static_cast<int>(rows[j] < low[j]) | static_cast<int>(rows[j] > high[j]);
    }
    outside += crossed;
  }
  return outside;
}

}  // namespace dovetail
