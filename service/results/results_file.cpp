#include "service/results/results_file.h"

#include <algorithm>
#include <cctype>
#include <limits>
#include <span>

#include "acquisition/recording/provenance.h"
#include "acquisition/recording/recording_keys.h"
#include "core/error.h"
#include "service/results/result_rows.h"

namespace curlew {
namespace {

constexpr float kInvalid = std::numeric_limits<float>::quiet_NaN();

template <typename Mask>
void append_masked(std::vector<float>& plane, const Image<float>& values, const Mask& valid) {
  for (std::size_t k = 0; k < values.size(); ++k) plane.push_back(valid(k) ? values[k] : kInvalid);
}

std::vector<float> lenslet_planes(const FrameSlot& slot,
                                  std::initializer_list<const Image<float>*> images) {
  std::vector<float> plane;
  for (const Image<float>* image : images)
    append_masked(plane, *image, [&](std::size_t k) { return slot.slopes.valid[k] != 0; });
  return plane;
}

std::vector<float> slopes_plane(const FrameSlot& slot) {
  return lenslet_planes(slot, {&slot.slopes.x, &slot.slopes.y});
}
std::vector<float> solenoidal_plane(const FrameSlot& slot) {
  return lenslet_planes(slot, {&slot.split.solenoidal_x, &slot.split.solenoidal_y});
}
std::vector<float> phase_plane(const FrameSlot& slot) {
  return lenslet_planes(slot, {&slot.split.phase});
}
std::vector<float> whole_phase_plane(const FrameSlot& slot) {
  return lenslet_planes(slot, {&slot.whole_phase});
}
std::vector<float> island_plane(const FrameSlot& slot) {
  return {slot.split.island.begin(), slot.split.island.end()};
}
std::vector<float> flux_plane(const FrameSlot& slot) {
  std::vector<float> plane;
  append_masked(plane, slot.centroids.flux_adu,
                [&](std::size_t k) { return slot.centroids.state[k] != LensletState::kUnlit; });
  return plane;
}
std::vector<float> circulation_plane(const FrameSlot& slot) {
  std::vector<float> plane;
  append_masked(plane, slot.circulation.value,
                [&](std::size_t k) { return slot.circulation.valid[k] != 0; });
  return plane;
}

template <typename Pixel>
std::vector<float> adu_of(const FrameSlot& slot) {
  const FrameFormat& format = slot.frame->format();
  const auto* pixels = slot.frame->view().data<Pixel>();
  std::vector<float> plane(format.pixels());
  std::transform(pixels, pixels + plane.size(), plane.begin(), [&](Pixel count) {
    return static_cast<float>(format.zero_adu + format.scale_adu * count);
  });
  return plane;
}
std::vector<float> frame_plane(const FrameSlot& slot) {
  return slot.frame->format().pixel_type == PixelType::kU8 ? adu_of<std::uint8_t>(slot)
                                                           : adu_of<std::uint16_t>(slot);
}

std::string upper(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return text;
}

std::vector<ColumnSpec> latency_columns() {
  std::vector<ColumnSpec> columns{{"FRAME", 'K', ""}};
  for (const Stage& stage : kStages) columns.push_back({upper(stage.name), 'E', "us"});
  columns.push_back({"PUBLISH", 'E', "us"});
  columns.push_back({"TOTAL", 'E', "us"});
  return columns;
}

}  // namespace

SaveOptions save_options_from(const std::vector<std::string>& words) {
  SaveOptions save;
  for (const std::string& word : words) {
    if (word == "slopes") {
      save.slopes = true;
    } else if (word == "flux") {
      save.flux = true;
    } else if (word == "phase") {
      save.phase = true;
    } else if (word == "whole_phase") {
      save.whole_phase = true;
    } else if (word == "solenoidal") {
      save.solenoidal = true;
    } else if (word == "circulation") {
      save.circulation = true;
    } else if (word == "zernike") {
      save.zernike = true;
    } else if (word == "frame") {
      save.frame = true;
    } else {
      throw UsageError(
          "--save: '" + word +
          "' is none of slopes, flux, phase, whole_phase, solenoidal, circulation, zernike, frame");
    }
  }
  return save;
}

ResultsFile::ResultsFile(const std::string& path, const Plan& plan, const SaveOptions& save,
                         std::int64_t frames, ResultsContent content)
    : path_(path),
      file_(FitsFile::create(path)),
      grid_(plan.grid),
      has_candidates_(content == ResultsContent::kShard && plan.tracker.has_value()),
      frame_table_("FRAMES", frame_columns(), path),
      vortex_table_("VORTICES", vortex_columns(), path),
      hole_table_("HOLES",
                  {{"FRAME", 'K', ""},
                   {"HOLE", 'J', ""},
                   {"CIRCULATION", 'D', "rad"},
                   {"X", 'D', ""},
                   {"Y", 'D', ""},
                   {"ONE_SUBLATTICE", 'J', ""}},
                  path),
      latency_table_("LATENCY", latency_columns(), path) {
  file_.create_image(ElementType::kU8, {});
  file_.write_key("CONTENT",
                  std::string(content == ResultsContent::kShard ? kShardContent : kResultsContent));
  write_optics(file_, plan.optics);
  write_detector(file_, plan.detector);
  Provenance provenance = provenance_of(plan.config);
  provenance.sensor_hash = plan.sensor_hash;
  write_provenance(file_, provenance);
  file_.write_key("METHOD", name_of(plan.detect.choice().method), "how vortices were found");
  file_.write_key("DATE-OBS", std::string(), "UTC of the first frame");  // in advance, see commit()
  const auto add_cube = [&](bool wanted, const std::string& name, const std::string& unit,
                            const std::vector<std::int64_t>& plane_shape,
                            std::vector<float> (*plane_of)(const FrameSlot&),
                            ElementType element = ElementType::kF32) {
    if (!wanted) return;
    Cube cube{static_cast<int>(cubes_.size()) + 1, 1, std::max<std::int64_t>(frames, 0), plane_of};
    std::vector<std::int64_t> shape{cube.planes};
    for (const std::int64_t n : plane_shape) {
      cube.plane_elements *= n;
      shape.push_back(n);
    }
    file_.create_image(element, shape, name, unit);
    cubes_.push_back(cube);
  };
  const int rows = grid_.rows;
  const int cols = grid_.cols;
  add_cube(save.slopes, "SLOPES", "rad", {2, rows, cols}, slopes_plane);
  add_cube(save.flux, "FLUX", "adu", {rows, cols}, flux_plane);
  add_cube(save.phase, "PHASE", "rad", {rows, cols}, phase_plane);
  add_cube(save.whole_phase, "WHOLE_PHASE", "rad", {rows, cols}, whole_phase_plane);
  add_cube(save.phase || save.whole_phase, "ISLAND", "", {rows, cols}, island_plane,
           ElementType::kI32);
  add_cube(save.solenoidal, "SOLENOIDAL", "rad", {2, rows, cols}, solenoidal_plane);
  if (save.zernike) modes_ = std::make_unique<ModeResults>(plan, path);
  add_cube(save.circulation, "CIRCULATION", "rad", {rows - 1, cols - 1}, circulation_plane);
  add_cube(save.frame, "FRAME", "adu", {plan.centroid.frame_rows, plan.centroid.frame_cols},
           frame_plane);
}

void ResultsFile::add(const FrameSlot& slot) {
  for (Cube& cube : cubes_) {
    file_.select(cube.hdu);
    if (frames_ >= cube.planes) file_.resize_planes(cube.planes = 2 * frames_ + 1);
    file_.write_pixels<float>(frames_ * cube.plane_elements, cube.plane(slot));
  }
  if (modes_) modes_->add(slot);
  const std::int64_t frame = slot.frame_index;
  const FrameHeader& header = slot.frame->header;
  if (frames_++ == 0) observed_ns_ = header.received_ns;
  const VortexList& vortices = has_candidates_ ? slot.candidates : slot.vortices;
  frame_table_.append(frame, header.sequence, header.camera_ns, header.received_ns, header.status,
                      slot.slopes.n_valid, vortices.size(), vortices.overflow(),
                      slot.centroids.n_lost, slot.split.n_islands);
  for (const Vortex& vortex : vortices) append_vortex(vortex_table_, frame, vortex, grid_);
  tracks_.add(frame, header, vortices);
  for (std::size_t hole = 0; hole < slot.split.holes.size(); ++hole) {
    const HoleCirculation& h = slot.split.holes[hole];
    hole_table_.append(frame, hole, h.circulation, h.x, h.y, h.one_sublattice ? 1 : 0);
  }
}

void ResultsFile::add_latency(const FrameSlot& slot) {
  const auto us = [](std::int64_t ns) { return static_cast<double>(ns) * 1e-3; };
  latency_table_.put(slot.frame_index);
  for (const std::int64_t ns : slot.latency.stage_ns) latency_table_.put(us(ns));
  latency_table_.put(us(slot.latency.publish_ns));
  latency_table_.put(us(slot.latency.total_ns));
}

void ResultsFile::commit() {
  for (const Cube& cube : cubes_) {
    file_.select(cube.hdu);
    if (cube.planes != frames_) file_.resize_planes(frames_);
  }
  file_.select(0);
  if (observed_ns_ > 0)
    file_.write_key("DATE-OBS", utc_text(observed_ns_), "UTC of the first frame");
  frame_table_.write(file_);
  vortex_table_.write(file_);
  hole_table_.write(file_);
  tracks_.table(path_).write(file_);
  latency_table_.write(file_);
  for (const MemoryTable& table : more_tables_) table.write(file_);
  if (modes_) modes_->write(file_);
  file_.commit();
}

}  // namespace curlew
