#include "service/publish/stream_publisher.h"

#include <algorithm>
#include <cctype>
#include <cstring>

#include "core/error.h"
#include "service/results/wavefront_meter.h"
#include "service/setting_words.h"

namespace curlew {
namespace {

constexpr std::size_t kVortexColumns = 13;

float* floats(std::byte* data) noexcept { return reinterpret_cast<float*>(data); }

/// Copies a map of lenslets. A lenslet without a slope gets 0, because loops elsewhere take what is
/// not a number for a command.
std::int64_t fill_lenslets(const FrameSlot& slot, const Image<float>& map, float* into) noexcept {
  for (std::size_t k = 0; k < map.size(); ++k) into[k] = slot.slopes.valid[k] != 0 ? map[k] : 0.0F;
  return slot.slopes.n_valid;
}

/// Writes two maps [rows, cols] side by side, the layout in which cacao takes a Shack–Hartmann
/// sensor.
template <typename Left, typename Right>
void fill_side_by_side(const LensletGrid& grid, float* into, Left&& left, Right&& right) noexcept {
  std::size_t k = 0;
  const std::ptrdiff_t width = std::ptrdiff_t{2} * grid.cols;
  for (int row = 0; row < grid.rows; ++row, into += width)
    for (int col = 0; col < grid.cols; ++col, ++k) {
      into[col] = left(k);
      into[grid.cols + col] = right(k);
    }
}

std::int64_t fill_slopes(const FrameSlot& slot, const StreamTarget& to) noexcept {
  const SlopeField& slopes = slot.slopes;
  fill_side_by_side(
      slot.plan->grid, floats(to.data),
      [&](std::size_t k) { return slopes.valid[k] != 0 ? slopes.x[k] : 0.0F; },
      [&](std::size_t k) { return slopes.valid[k] != 0 ? slopes.y[k] : 0.0F; });
  return slopes.n_valid;
}

std::int64_t fill_mask(const FrameSlot& slot, const StreamTarget& to) noexcept {
  const auto valid = [&](std::size_t k) { return slot.slopes.valid[k] != 0 ? 1.0F : 0.0F; };
  fill_side_by_side(slot.plan->grid, floats(to.data), valid, valid);
  return slot.slopes.n_valid;
}

std::int64_t fill_flux(const FrameSlot& slot, const StreamTarget& to) noexcept {
  const Image<float>& flux = slot.centroids.flux_adu;
  for (std::size_t k = 0; k < flux.size(); ++k)
    floats(to.data)[k] = slot.centroids.state[k] != LensletState::kUnlit ? flux[k] : 0.0F;
  return slot.slopes.n_valid;
}

std::int64_t fill_phase(const FrameSlot& slot, const StreamTarget& to) noexcept {
  return fill_lenslets(slot, slot.split.phase, floats(to.data));
}

std::int64_t fill_whole_phase(const FrameSlot& slot, const StreamTarget& to) noexcept {
  return fill_lenslets(slot, slot.whole_phase, floats(to.data));
}

std::int64_t fill_circulation(const FrameSlot& slot, const StreamTarget& to) noexcept {
  const CirculationMap& map = slot.circulation;
  for (std::size_t k = 0; k < map.value.size(); ++k)
    floats(to.data)[k] = map.valid[k] != 0 ? map.value[k] : 0.0F;
  return map.n_valid;
}

/// Rows beyond the count are 0. docs/cacao.md tells the columns.
std::int64_t fill_vortices(const FrameSlot& slot, const StreamTarget& to) noexcept {
  auto* row = reinterpret_cast<double*>(to.data);
  const auto put = [&row](auto value) { *row++ = static_cast<double>(value); };
  const std::size_t count = std::min(slot.vortices.size(), to.capacity);
  for (std::size_t i = 0; i < count; ++i) {
    const Vortex& v = slot.vortices[i];
    put(v.x), put(v.y), put(v.charge), put(v.circulation), put(v.significance);
    put(v.probability), put(v.variance_x), put(v.variance_y), put(v.covariance_xy);
    put(v.velocity_x), put(v.velocity_y), put(v.flags), put(v.track);
  }
  std::fill_n(row, (to.capacity - count) * kVortexColumns, 0.0);
  return static_cast<std::int64_t>(count);
}

std::int64_t fill_frame(const FrameSlot& slot, const StreamTarget& to) noexcept {
  const FrameFormat& format = slot.frame->format();
  std::memcpy(to.data, slot.frame->view().pixels, format.bytes());
  return static_cast<std::int64_t>(format.pixels());
}

/// Where the lenslets do not tell the modes apart, all are 0, and so is the count.
std::int64_t fill_zernike(const FrameSlot& slot, const StreamTarget& to) noexcept {
  const bool fitted = to.modes->fit(slot.slopes);
  const Eigen::VectorXd& coefficients = to.modes->coefficients();
  for (Eigen::Index i = 0; i < coefficients.size(); ++i)
    floats(to.data)[i] = fitted ? static_cast<float>(coefficients[i]) : 0.0F;
  return fitted ? coefficients.size() : 0;
}

/// What a stream is made of, and by what it is filled.
struct Recipe {
  FillStream fill;
  StreamType type;
  std::uint32_t cols;
  std::uint32_t rows;
  const char* unit;
  const char* count_name;
  const char* count_comment;
};

Recipe recipe_of(PublishedStream stream, const Plan& plan, const FrameFormat& format,
                 std::uint32_t modes) {
  const auto cols = static_cast<std::uint32_t>(plan.grid.cols);
  const auto rows = static_cast<std::uint32_t>(plan.grid.rows);
  constexpr auto kF32 = StreamType::kF32;
  constexpr const char* kValid = "N_VALID";
  constexpr const char* kLenslets = "lenslets with a slope";
  switch (stream) {
    case PublishedStream::kSlopes:
      return {fill_slopes, kF32, 2 * cols, rows, "rad/pitch", kValid, kLenslets};
    case PublishedStream::kMask:
      return {fill_mask, kF32, 2 * cols, rows, "", kValid, kLenslets};
    case PublishedStream::kFlux:
      return {fill_flux, kF32, cols, rows, "adu", kValid, kLenslets};
    case PublishedStream::kPhase:
      return {fill_phase, kF32, cols, rows, "rad", kValid, kLenslets};
    case PublishedStream::kWholePhase:
      return {fill_whole_phase, kF32, cols, rows, "rad", kValid, kLenslets};
    case PublishedStream::kCirculation:
      return {fill_circulation, kF32, cols - 1, rows - 1, "rad", kValid, "cells with a value"};
    case PublishedStream::kVortices:
      return {fill_vortices,
              StreamType::kF64,
              static_cast<std::uint32_t>(kVortexColumns),
              static_cast<std::uint32_t>(plan.detect.capacity()),
              "",
              "COUNT",
              "rows that hold a vortex"};
    case PublishedStream::kZernike:
      return {fill_zernike, kF32, modes, 1, "rad", "COUNT", "modes from Noll 2 on; 0: not known"};
    case PublishedStream::kFrame:
      break;
  }
  return {fill_frame,
          format.pixel_type == PixelType::kU8 ? StreamType::kU8 : StreamType::kU16,
          static_cast<std::uint32_t>(format.cols),
          static_cast<std::uint32_t>(format.rows),
          "counts",
          "",
          ""};
}

std::string word_of(PublishedStream stream) {
  for (const auto& word : words_of(stream))
    if (word.value == stream) return std::string(word.text);
  return {};
}

void check_prefix(const std::string& prefix) {
  constexpr std::size_t kLongest = 60;
  const bool plain = std::all_of(prefix.begin(), prefix.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.';
  });
  if (!plain || prefix.size() > kLongest)
    throw UsageError("publish.prefix '" + prefix +
                     "' must be at most 60 letters, digits, '_', '-' and '.'");
}

}  // namespace

StreamPublisher::StreamPublisher(const PublishOptions& options, const Plan& plan,
                                 const FrameFormat& format)
    : grid_(plan.grid), format_(format) {
  check_prefix(options.prefix);
  const std::string folder = options.folder.empty() ? stream_folder() : options.folder;
  std::vector<PublishedStream> wanted = options.streams;
  std::sort(wanted.begin(), wanted.end());
  wanted.erase(std::unique(wanted.begin(), wanted.end()), wanted.end());
  if (std::count(wanted.begin(), wanted.end(), PublishedStream::kZernike) > 0) make_modes(plan);
  const auto modes = static_cast<std::uint32_t>(modes_ ? mode_plan_->modes() : 0);
  for (const PublishedStream stream : wanted) {
    const Recipe recipe = recipe_of(stream, plan, format, modes);
    const StreamDescription description{options.prefix + word_of(stream),
                                        recipe.type,
                                        {recipe.cols, recipe.rows},
                                        recipe.unit,
                                        recipe.count_name,
                                        recipe.count_comment};
    streams_.push_back({recipe.fill,
                        stream == PublishedStream::kVortices ? plan.detect.capacity() : 0,
                        std::make_unique<StreamWriter>(folder, description)});
  }
}

void StreamPublisher::make_modes(const Plan& plan) {
  mode_plan_ = std::make_unique<const ModePlan>(modes_of(plan.split));
  if (mode_plan_->modes() == 0)
    throw UsageError("the stream 'zernike' needs more lenslets; take it out of [publish] streams");
  modes_ = std::make_unique<ModeFit>(*mode_plan_);
}

void StreamPublisher::publish(const FrameSlot& slot) noexcept {
  const LensletGrid& grid = slot.plan->grid;
  if (grid.rows != grid_.rows || grid.cols != grid_.cols || !(slot.frame->format() == format_))
    return;
  const FrameHeader& header = slot.frame->header;
  const StreamStamp stamp{slot.frame_index, header.sequence, header.received_ns, header.status};
  for (Stream& stream : streams_) {
    const StreamTarget to{stream.writer->begin(), stream.capacity, modes_.get()};
    const std::int64_t count = stream.fill(slot, to);
    stream.writer->end(stamp, count);
  }
}

}  // namespace curlew
