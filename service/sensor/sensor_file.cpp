#include "service/sensor/sensor_file.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/recording_keys.h"
#include "core/error.h"
#include "core/memory_limit.h"
#include "service/program/hash.h"
#include "service/sensor/sensor_check.h"

namespace curlew {
namespace {

// A header with more lenslets or more pixels a side than this is taken for damaged.
constexpr int kMaxLenslets = 4096;
constexpr int kMaxPixels = 1 << 20;

constexpr std::array kBendMaps{&Sensor::bend2_x, &Sensor::bend2_y, &Sensor::bend3_x,
                               &Sensor::bend3_y};  // as BEND has them

template <typename T>
std::span<const T> values(const Image<T>& image) {
  return {image.data(), image.size()};
}

template <typename T>
void write_image(FitsFile& file, ElementType element, const Image<T>& image,
                 const std::string& name, const std::string& unit = "") {
  if (image.empty()) return;
  file.create_image(element, {image.rows(), image.cols()}, name, unit);
  file.write_pixels<T>(0, values(image));
}

void write_grid(FitsFile& file, const LensletGrid& grid) {
  file.write_key("ORIGINX", grid.origin_x_px, "x of lenslet (0,0)", "pix");
  file.write_key("ORIGINY", grid.origin_y_px, "y of lenslet (0,0)", "pix");
  file.write_key("P11", grid.p11, "pixel = ORIGIN + P (col, row)", "pix");
  file.write_key("P12", grid.p12, "", "pix");
  file.write_key("P21", grid.p21, "", "pix");
  file.write_key("P22", grid.p22, "", "pix");
  file.write_key("PITCHPX", grid.pitch_px(), "lenslet pitch on the detector", "pix");
  file.write_key("ROTDEG", grid.rotation_deg(), "column axis from +x towards +y", "deg");
  file.write_key("LAYOUT", std::string("SQUARE"));
}

/// Writes all keys of the primary header.
void write_keys(FitsFile& file, const Sensor& sensor) {
  file.write_key("CONTENT", std::string("CURLEW SENSOR"));
  write_optics(file, sensor.optics);
  write_detector(file, sensor.detector);
  FrameFormat region;
  region.offset_x_px = sensor.offset_x_px;
  region.offset_y_px = sensor.offset_y_px;
  region.binning = sensor.binning;
  write_region(file, region);
  file.write_key("ROWS", std::int64_t{sensor.grid.rows}, "lenslet rows");
  file.write_key("COLS", std::int64_t{sensor.grid.cols}, "lenslet columns");
  file.write_key("NX", std::int64_t{sensor.frame_cols}, "detector columns");
  file.write_key("NY", std::int64_t{sensor.frame_rows}, "detector rows");
  write_grid(file, sensor.grid);
  if (sensor.pixel_bits != 0)
    file.write_key("PIXBITS", std::int64_t{sensor.pixel_bits}, "bits of a pixel in the reference");
  file.write_key("RESIDUAL", sensor.residual_px, "rms of the spots from the grid", "pix");
  file.write_key("BACKGRND", sensor.background_adu, "subtracted where there is no dark", "adu");
  if (std::isfinite(sensor.spot_sigma_px))
    file.write_key("SPOTSIG", sensor.spot_sigma_px, "sigma of the reference spots", "pix");
  if (std::isfinite(sensor.spot_sharpness))
    file.write_key("SPOTPEAK", sensor.spot_sharpness, "peak over its second brightest neighbour");
  if (sensor.core_threshold > 0.0)
    file.write_key("CORETHR", sensor.core_threshold, "positions are of light over this of a peak");
  if (std::isfinite(sensor.spot_gaussian_px))
    file.write_key("SPOTGAUS", sensor.spot_gaussian_px,
                   "sigma of the Gaussian most like the spots' cores", "pix");
  if (std::isfinite(sensor.spot_blur_px))
    file.write_key("SPOTBLUR", sensor.spot_blur_px, "sigma of the spots beyond diffraction", "pix");
  file.write_key("CENTROID", std::string(name_of(sensor.method)), "method that GAIN is of");
}

void write_lenslet_maps(FitsFile& file, const Sensor& sensor) {
  write_image(file, ElementType::kF32, sensor.ref_x_px, "REFX", "pix");
  write_image(file, ElementType::kF32, sensor.ref_y_px, "REFY", "pix");
  write_image(file, ElementType::kU8, sensor.valid, "VALID");
  write_image(file, ElementType::kF32, sensor.flux_adu, "FLUX", "adu");

  const Image<float>& any = sensor.ref_x_px;
  std::vector<std::int32_t> window;
  for (int Window::*side : {&Window::x0, &Window::y0, &Window::w, &Window::h})
    for (const Window& w : sensor.window) window.push_back(w.*side);
  file.create_image(ElementType::kI32, {4, any.rows(), any.cols()}, "WINDOW", "pix");
  file.write_pixels<std::int32_t>(0, window);

  file.create_image(ElementType::kF32, {2, any.rows(), any.cols()}, "GAIN");
  file.write_pixels<float>(0, values(sensor.gain_x));
  file.write_pixels<float>(static_cast<std::int64_t>(any.size()), values(sensor.gain_y));

  if (sensor.bend2_x.empty()) return;
  file.create_image(ElementType::kF32, {4, any.rows(), any.cols()}, "BEND");
  std::int64_t first = 0;
  for (const auto map : kBendMaps) {
    file.write_pixels<float>(first, values(sensor.*map));
    first += static_cast<std::int64_t>(any.size());
  }
}

/// Writes those maps of the frame's pixels that are known.
void write_pixel_maps(FitsFile& file, const Sensor& sensor) {
  write_image(file, ElementType::kF32, sensor.dark_adu, "DARK", "adu");
  write_image(file, ElementType::kF32, sensor.flat, "FLAT");
  write_image(file, ElementType::kU8, sensor.bad_pixel, "BADPIX");
}

/// provenance: null where only the sensor itself matters.
void write_content(FitsFile& file, const Sensor& sensor, const Provenance* provenance) {
  file.create_image(ElementType::kU8, {});
  write_keys(file, sensor);
  if (provenance != nullptr) write_provenance(file, *provenance);
  write_lenslet_maps(file, sensor);
  write_pixel_maps(file, sensor);
}

template <typename T>
Image<T> read_image(FitsFile& file, const std::string& name, int rows, int cols) {
  file.select(name);
  if (file.image().shape != std::vector<std::int64_t>{rows, cols})
    throw Failure(file.path() + ": image " + name + " is not " + std::to_string(rows) + " x " +
                  std::to_string(cols) + ", calibrate again");
  Image<T> image(rows, cols);
  file.read_pixels<T>(0, {image.data(), image.size()});
  return image;
}

double required(FitsFile& file, const std::string& name) {
  const auto value = file.key_double(name);
  if (!value || !std::isfinite(*value))
    throw Failure(file.path() + " is no sensor file: key " + name +
                  " is missing; make one with 'curlew calibrate'");
  return *value;
}

int required_size(FitsFile& file, const std::string& name, int limit) {
  const double value = required(file, name);
  if (value != std::floor(value) || value < 1 || value > limit)
    throw Failure(file.path() + ": key " + name + " is not a size, calibrate again");
  return static_cast<int>(value);
}

CentroidMethod read_method(FitsFile& file) {
  const std::string method = file.key_string("CENTROID").value_or("thresholded");
  const auto* known = std::find(kCentroidMethodNames.begin(), kCentroidMethodNames.end(), method);
  if (known == kCentroidMethodNames.end())
    throw Failure(file.path() + ": centroid method " + method + " is not known, calibrate again");
  return static_cast<CentroidMethod>(known - kCentroidMethodNames.begin());
}

double read_core_threshold(FitsFile& file) {
  const double part = file.key_double("CORETHR").value_or(0.0);
  if (!(part >= 0.0 && part < 1.0))
    throw Failure(file.path() + ": key CORETHR is no part of a peak, calibrate again");
  return part;
}

void read_frame_region(FitsFile& file, Sensor& sensor) {
  FrameFormat region;
  read_region(file, region);
  sensor.offset_x_px = region.offset_x_px;
  sensor.offset_y_px = region.offset_y_px;
  sensor.binning = region.binning;
}

/// Reads everything from the primary header.
void read_keys(FitsFile& file, Sensor& sensor) {
  read_optics(file, sensor.optics);
  read_detector(file, sensor.detector);
  read_frame_region(file, sensor);
  const int rows = required_size(file, "ROWS", kMaxLenslets);
  const int cols = required_size(file, "COLS", kMaxLenslets);
  sensor.frame_cols = required_size(file, "NX", kMaxPixels);
  sensor.frame_rows = required_size(file, "NY", kMaxPixels);
  // Frames and lenslets are worked on as a whole; this is the least that they take.
  require_memory(file.path() + " has " + std::to_string(rows) + " x " + std::to_string(cols) +
                     " lenslets on " + std::to_string(sensor.frame_cols) + " x " +
                     std::to_string(sensor.frame_rows) + " pixels, which",
                 200.0 * rows * cols + 26.0 * sensor.frame_cols * sensor.frame_rows);
  sensor.grid = {rows,
                 cols,
                 required(file, "ORIGINX"),
                 required(file, "ORIGINY"),
                 required(file, "P11"),
                 required(file, "P12"),
                 required(file, "P21"),
                 required(file, "P22")};
  sensor.pixel_bits = static_cast<int>(file.key_double("PIXBITS").value_or(0.0));
  sensor.residual_px = file.key_double("RESIDUAL").value_or(0.0);
  sensor.background_adu = file.key_double("BACKGRND").value_or(0.0);
  const std::string layout = file.key_string("LAYOUT").value_or("SQUARE");
  if (layout != "SQUARE")
    throw Failure(file.path() + ": lenslet layout " + layout + " is not supported, only SQUARE is");
  sensor.spot_blur_px = file.key_double("SPOTBLUR").value_or(kUnknown);
  sensor.spot_sigma_px = file.key_double("SPOTSIG").value_or(kUnknown);
  sensor.spot_gaussian_px = file.key_double("SPOTGAUS").value_or(kUnknown);
  sensor.core_threshold = read_core_threshold(file);
  sensor.spot_sharpness = file.key_double("SPOTPEAK").value_or(kUnknown);
  sensor.method = read_method(file);
}

/// Selects an image that holds `planes` maps of the lenslets.
void select_maps(FitsFile& file, const std::string& name, int planes, const LensletGrid& grid) {
  file.select(name);
  if (file.image().shape != std::vector<std::int64_t>{planes, grid.rows, grid.cols})
    throw Failure(file.path() + ": image " + name + " does not fit the grid, calibrate again");
}

void read_windows(FitsFile& file, Sensor& sensor) {
  select_maps(file, "WINDOW", 4, sensor.grid);
  sensor.window = Image<Window>(sensor.grid.rows, sensor.grid.cols);
  const std::size_t n = sensor.window.size();
  std::vector<std::int32_t> sides(4 * n);
  file.read_pixels<std::int32_t>(0, sides);
  for (std::size_t k = 0; k < n; ++k)
    sensor.window[k] = {sides[k], sides[n + k], sides[2 * n + k], sides[3 * n + k]};
}

void read_gains(FitsFile& file, Sensor& sensor) {
  select_maps(file, "GAIN", 2, sensor.grid);
  sensor.gain_x = Image<float>(sensor.grid.rows, sensor.grid.cols);
  sensor.gain_y = Image<float>(sensor.grid.rows, sensor.grid.cols);
  const std::size_t n = sensor.gain_x.size();
  file.read_pixels<float>(0, {sensor.gain_x.data(), n});
  file.read_pixels<float>(static_cast<std::int64_t>(n), {sensor.gain_y.data(), n});

  if (!file.try_select("BEND")) return;
  select_maps(file, "BEND", 4, sensor.grid);
  std::int64_t first = 0;
  for (const auto map : kBendMaps) {
    sensor.*map = Image<float>(sensor.grid.rows, sensor.grid.cols);
    file.read_pixels<float>(first, {(sensor.*map).data(), n});
    first += static_cast<std::int64_t>(n);
  }
}

void read_lenslet_maps(FitsFile& file, Sensor& sensor) {
  const int rows = sensor.grid.rows;
  const int cols = sensor.grid.cols;
  sensor.ref_x_px = read_image<float>(file, "REFX", rows, cols);
  sensor.ref_y_px = read_image<float>(file, "REFY", rows, cols);
  sensor.valid = read_image<std::uint8_t>(file, "VALID", rows, cols);
  sensor.flux_adu = file.try_select("FLUX") ? read_image<float>(file, "FLUX", rows, cols)
                                            : Image<float>(rows, cols);
  read_windows(file, sensor);
  read_gains(file, sensor);
}

/// Reads those maps of the frame's pixels that the file has.
void read_pixel_maps(FitsFile& file, Sensor& sensor) {
  const auto read_optional = [&]<typename T>(const std::string& name, Image<T>& image) {
    if (file.try_select(name))
      image = read_image<T>(file, name, sensor.frame_rows, sensor.frame_cols);
  };
  read_optional("DARK", sensor.dark_adu);
  read_optional("FLAT", sensor.flat);
  read_optional("BADPIX", sensor.bad_pixel);
}

}  // namespace

void write_sensor(const std::string& path, const Sensor& sensor, const Provenance& provenance) {
  FitsFile file = FitsFile::create(path);
  write_content(file, sensor, &provenance);
  file.commit();
}

std::string sensor_hash(const Sensor& sensor) {
  FitsFile file = FitsFile::create_in_memory("the sensor");
  write_content(file, sensor, nullptr);
  const std::span<const std::byte> bytes = file.memory();
  return hash_text({reinterpret_cast<const char*>(bytes.data()), bytes.size()});
}

Sensor read_sensor(const std::string& path) {
  FitsFile file = FitsFile::open(path);
  file.select(0);
  Sensor sensor;
  read_keys(file, sensor);
  read_lenslet_maps(file, sensor);
  read_pixel_maps(file, sensor);
  for (std::size_t k = 0; k < sensor.valid.size(); ++k) {
    if (sensor.valid[k] == 0)
      drop_lenslet(sensor, k);
    else
      sensor.valid[k] = 1;
  }
  check_sensor(path, sensor);
  return sensor;
}

}  // namespace curlew
