#include "service/results/result_rows.h"

namespace curlew {

std::vector<ColumnSpec> frame_columns() {
  return {{"FRAME", 'K', ""},         {"SEQUENCE", 'K', ""}, {"CAMERA_NS", 'K', "ns"},
          {"RECEIVED_NS", 'K', "ns"}, {"STATUS", 'J', ""},   {"N_VALID", 'J', ""},
          {"N_VORTICES", 'J', ""},    {"OVERFLOW", 'J', ""}, {"N_LOST", 'J', ""},
          {"N_ISLANDS", 'J', ""}};
}

std::vector<ColumnSpec> vortex_columns() {
  return {{"FRAME", 'K', ""},
          {"X", 'D', ""},
          {"Y", 'D', ""},
          {"CHARGE", 'J', ""},
          {"CIRCULATION", 'D', "rad"},
          {"SIGNIFICANCE", 'D', ""},
          {"X_PX", 'D', "pix"},
          {"Y_PX", 'D', "pix"},
          {"FLAGS", 'J', ""},
          {"TRACK", 'K', ""},
          {"PROBABILITY", 'D', ""},
          {"VAR_X", 'D', ""},
          {"VAR_Y", 'D', ""},
          {"COV_XY", 'D', ""},
          {"VX", 'D', "s-1"},
          {"VY", 'D', "s-1"}};
}

void append_vortex(RowTable& table, std::int64_t frame, const Vortex& v, const LensletGrid& grid) {
  const auto pixel = grid.pixel_from_lenslet(static_cast<double>(v.x), static_cast<double>(v.y));
  table.append(frame, v.x, v.y, v.charge, v.circulation, v.significance, pixel[0], pixel[1],
               v.flags, v.track, v.probability, v.variance_x, v.variance_y, v.covariance_xy,
               v.velocity_x, v.velocity_y);
}

VortexRow::VortexRow() {
  const std::vector<ColumnSpec> columns = vortex_columns();
  const auto at = [&](const char* name) { return cell_offset(columns, name); };
  bytes_ = row_bytes(columns);
  frame_ = at("FRAME");
  x_ = at("X");
  y_ = at("Y");
  charge_ = at("CHARGE");
  circulation_ = at("CIRCULATION");
  significance_ = at("SIGNIFICANCE");
  flags_ = at("FLAGS");
  track_ = at("TRACK");
  probability_ = at("PROBABILITY");
  variance_x_ = at("VAR_X");
  variance_y_ = at("VAR_Y");
  covariance_xy_ = at("COV_XY");
  velocity_x_ = at("VX");
  velocity_y_ = at("VY");
}

std::int64_t VortexRow::frame(const std::byte* row) const {
  return cell_value<std::int64_t>(row + frame_);
}

Vortex VortexRow::vortex(const std::byte* row) const {
  // The columns are doubles that were floats.
  const auto real = [row](std::size_t at) {
    return static_cast<float>(cell_value<double>(row + at));
  };
  return {.x = real(x_),
          .y = real(y_),
          .charge = cell_value<std::int32_t>(row + charge_),
          .circulation = real(circulation_),
          .significance = real(significance_),
          .probability = real(probability_),
          .variance_x = real(variance_x_),
          .variance_y = real(variance_y_),
          .covariance_xy = real(covariance_xy_),
          .velocity_x = real(velocity_x_),
          .velocity_y = real(velocity_y_),
          .flags = static_cast<std::uint32_t>(cell_value<std::int32_t>(row + flags_)),
          .track = cell_value<std::int64_t>(row + track_)};
}

}  // namespace curlew
