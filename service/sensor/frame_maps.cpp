#include "service/sensor/frame_maps.h"

#include <spdlog/fmt/fmt.h>

#include <cstdint>
#include <span>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/fits_cube.h"
#include "acquisition/recording/recording_keys.h"
#include "centroiding/calibration/bad_pixel_search.h"
#include "centroiding/calibration/dark_check.h"
#include "core/error.h"
#include "service/program/version.h"

namespace curlew {
namespace {

Image<float> variance_of(const MeanImage& stack) {
  return stack.variance.empty() ? Image<float>{} : converted<float>(stack.variance);
}

void write_bad_pixels(const std::string& path, const Image<std::uint8_t>& map,
                      const FrameFormat& region) {
  FitsFile file = FitsFile::create(path);
  file.create_image(ElementType::kU8, {map.rows(), map.cols()});
  file.write_key("CREATOR", std::string(kProgram));
  file.write_key("CONTENT", std::string("CURLEW BAD PIXELS"));
  write_region(file, region);
  file.write_pixels<std::uint8_t>(0, std::span(map.data(), map.size()));
  file.commit();
}

}  // namespace

MeanImage read_map(const std::string& path, const MeanImage& reference, FrameSelection selection) {
  const FitsCube cube = FitsCube::open(path, selection);
  if (cube.image_rows == reference.image_rows && cube.image_cols == reference.image_cols)
    selection.region = reference.part;
  MeanImage map = read_mean_image(path, selection);
  const FrameFormat& a = map.region;
  const FrameFormat& b = reference.region;
  if (a.offset_x_px != b.offset_x_px || a.offset_y_px != b.offset_y_px || a.binning != b.binning)
    throw Failure(fmt::format(
        "{} begins at ({}, {}) binned {}, the reference at ({}, {}) binned {}", path, a.offset_x_px,
        a.offset_y_px, a.binning, b.offset_x_px, b.offset_y_px, b.binning));
  if (a.rows != b.rows || a.cols != b.cols)
    throw Failure(fmt::format("{} is {} x {} px, the reference {} x {}", path, a.cols, a.rows,
                              b.cols, b.rows));
  return map;
}

std::string check_dark(const std::string& path, const MeanImage& dark) {
  const auto mean = converted<float>(dark.mean);
  const DarkFrame measured = measure_dark(mean, variance_of(dark), static_cast<int>(dark.frames));
  const std::string light = find_light_in_dark(mean, measured);
  if (!light.empty())
    throw Failure(fmt::format("{} is not dark: {}; take it with the light off", path, light));
  return fmt::format(
      "a dark of {:.5g} ADU with {:.4g} ADU of noise {}", measured.level_adu, measured.noise_adu,
      dark.frames > 1 ? fmt::format("over {} frames", dark.frames) : "between pixels");
}

void make_bad_pixels(const std::string& dark_path, const FrameSelection& dark_selection,
                     const std::string& flat_path, const FrameSelection& flat_selection,
                     const std::string& out) {
  constexpr int kAtMostOneIn = 20;
  const MeanImage dark = read_mean_image(dark_path, dark_selection);
  fmt::print("{}: {}\n", dark_path, check_dark(dark_path, dark));
  const Image<float> flat = flat_path.empty()
                                ? Image<float>{}
                                : converted<float>(read_map(flat_path, dark, flat_selection).mean);
  const BadPixels bad = find_bad_pixels(converted<float>(dark.mean), variance_of(dark),
                                        static_cast<int>(dark.frames), flat);
  const int all = bad.no_number + bad.hot + bad.noisy + bad.dead;
  const std::string text = fmt::format(
      "{} of {} pixels are bad: {} far off in the mean, {} too noisy, {} dead in the "
      "flat, {} no number",
      all, bad.map.size(), bad.hot, bad.noisy, bad.dead, bad.no_number);
  if (static_cast<std::size_t>(all) * kAtMostOneIn > bad.map.size())
    throw Failure(text +
                  ", which is no detector to work with: is it a dark, and the flat evenly "
                  "lit, without lenslets?");
  write_bad_pixels(out, bad.map, dark.region);
  fmt::print("{}: {}\n", out, text);
  if (dark.frames < 5)
    fmt::print("  noise was not looked at: it takes a stack of 5 darks or more\n");
  if (flat_path.empty()) fmt::print("  dead pixels are found with --flat\n");
}

}  // namespace curlew
