#include "service/export/aot_export.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <ctime>
#include <limits>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "acquisition/recording/fits_source.h"
#include "centroiding/sensor.h"
#include "core/as_size.h"
#include "core/error.h"
#include "core/memory_limit.h"
#include "service/export/aot_tables.h"
#include "service/program/version.h"
#include "service/results/memory_table.h"
#include "service/sensor/sensor_file.h"

namespace curlew {
namespace {

constexpr float kNoValue = std::numeric_limits<float>::quiet_NaN();

/// A results file's frames and images.
struct SavedResults {
  std::vector<std::int64_t> sequence;
  std::vector<double> utc_s;  ///< of receipt; empty: not known
  std::vector<float> slopes;  ///< [frames, 2, lenslets]
  std::vector<float> flux;    ///< [frames, lenslets]
};

std::vector<float> read_image(FitsFile& file, const std::string& name) {
  if (!file.try_select(name))
    throw Failure(file.path() + " has no " + name + "; replay again with --save slopes,flux");
  const std::int64_t elements = file.image().elements();
  constexpr double kBytes = 2 * sizeof(float);  // as it is read, and what is written of it
  require_memory(name + " of " + file.path(), kBytes * static_cast<double>(elements));
  std::vector<float> values(as_size(elements));
  file.read_pixels<float>(0, values);
  return values;
}

SavedResults read_saved(FitsFile& file, std::size_t lenslets) {
  SavedResults saved;
  saved.slopes = read_image(file, "SLOPES");
  saved.flux = read_image(file, "FLUX");
  file.select("FRAMES");
  const std::size_t frames = as_size(file.row_count());
  if (saved.flux.size() != frames * lenslets || saved.slopes.size() != 2 * saved.flux.size())
    throw Failure(file.path() +
                  " is of another sensor; name the sensor file that it was replayed with");
  saved.sequence.resize(frames);
  file.read_column<std::int64_t>("SEQUENCE", 0, saved.sequence);
  std::vector<std::int64_t> received(frames);
  file.read_column<std::int64_t>("RECEIVED_NS", 0, received);
  if (std::find(received.begin(), received.end(), 0) == received.end())
    for (const std::int64_t ns : received) saved.utc_s.push_back(1e-9 * static_cast<double>(ns));
  return saved;
}

std::vector<std::size_t> lit_lenslets(const Sensor& sensor) {
  std::vector<std::size_t> lit;
  for (std::size_t k = 0; k < sensor.valid.size(); ++k)
    if (sensor.valid[k] != 0) lit.push_back(k);
  return lit;
}

/// Writes an image under a name, and that it is of every frame where it is.
void write_image(FitsFile& file, const std::string& name, const std::vector<std::int64_t>& shape,
                 const std::vector<float>& values, const std::string& unit, bool timed) {
  file.create_image(ElementType::kF32, shape, name, unit);
  file.write_pixels<float>(0, values);
  if (timed) file.write_key("TIME_UID", row_reference("frames"));
}

/// Picks the lit lenslets out of planes of all lenslets.
std::vector<float> pick(const std::vector<float>& planes, const std::vector<std::size_t>& lit,
                        std::size_t lenslets) {
  std::vector<float> picked;
  for (std::size_t plane = 0; plane < planes.size(); plane += lenslets)
    for (const std::size_t k : lit) picked.push_back(planes[plane + k]);
  return picked;
}

/// Returns where the reference spots lie off the regular grid, as slopes: [2, lit].
std::vector<float> reference_slopes(const Sensor& sensor, const std::vector<std::size_t>& lit) {
  std::vector<float> slopes(2 * lit.size(), kNoValue);
  const double rad = sensor.optics.slope_rad_per_px() * sensor.grid.pitch_px();
  for (std::size_t i = 0; i < lit.size(); ++i) {
    const std::size_t k = lit[i];
    const auto place = sensor.grid.lenslet_from_pixel(static_cast<double>(sensor.ref_x_px[k]),
                                                      static_cast<double>(sensor.ref_y_px[k]));
    const auto cols = static_cast<std::size_t>(sensor.grid.cols);
    const std::size_t row = k / cols;
    const std::size_t col = k % cols;
    slopes[i] = static_cast<float>(rad * (place[0] - static_cast<double>(col)));
    slopes[lit.size() + i] = static_cast<float>(rad * (place[1] - static_cast<double>(row)));
  }
  return slopes;
}

void write_mask(FitsFile& file, const Sensor& sensor, const std::vector<std::size_t>& lit) {
  std::vector<std::int32_t> mask(sensor.valid.size(), -1);
  for (std::size_t i = 0; i < lit.size(); ++i) mask[lit[i]] = static_cast<std::int32_t>(i);
  file.create_image(ElementType::kI32, {sensor.grid.rows, sensor.grid.cols}, "SUBAPERTURE_MASK");
  file.write_pixels<std::int32_t>(0, mask);
}

void write_frames(FitsFile& file, FitsSource& source) {
  const FrameFormat& format = source.format();
  const bool bytes = format.pixel_type == PixelType::kU8;
  file.create_image(bytes ? ElementType::kU8 : ElementType::kU16,
                    {source.frame_count(), format.rows, format.cols}, "PIXEL_INTENSITIES", "adu");
  file.write_key("TIME_UID", row_reference("frames"));
  FrameBuffer frame(format);
  std::int64_t first = 0;
  while (source.next(frame) == Delivery::kFrame) {
    const FrameView view = frame.view();
    if (bytes)
      file.write_pixels<std::uint8_t>(first, {view.data<std::uint8_t>(), format.pixels()});
    else
      file.write_pixels<std::uint16_t>(first, {view.data<std::uint16_t>(), format.pixels()});
    first += static_cast<std::int64_t>(format.pixels());
  }
}

std::string iso_of(double utc_s) {
  const auto whole = static_cast<std::time_t>(std::floor(utc_s));
  std::tm utc{};
  gmtime_r(&whole, &utc);
  std::array<char, 40> text{};
  std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%S", &utc);
  return text.data();
}

void write_primary(FitsFile& file, const SavedResults& saved) {
  file.create_image(ElementType::kU8, {});
  file.write_key("AOT-VERS", std::string("2.0.0"));
  file.write_key("TIMESYS", std::string("UTC"));
  file.write_key("AO-MODE", std::string("SCAO"));
  file.write_key("SYS-NAME", std::string("Curlew"));
  if (saved.utc_s.empty()) return;
  file.write_key("DATE-BEG", iso_of(saved.utc_s.front()));
  file.write_key("DATE-END", iso_of(saved.utc_s.back()));
}

AotRow detector_row(const Sensor& sensor, const SavedResults& saved) {
  AotRow row{{"UID", std::string("detector")},
             {"PIXEL_INTENSITIES", image_reference("PIXEL_INTENSITIES")},
             {"GAIN", sensor.detector.e_per_adu},
             {"BINNING", std::int64_t{sensor.binning}}};
  if (!sensor.dark_adu.empty()) row["DARK"] = image_reference("DARK");
  if (!sensor.flat.empty()) row["FLAT_FIELD"] = image_reference("FLAT_FIELD");
  if (!sensor.bad_pixel.empty()) row["BAD_PIXEL_MAP"] = image_reference("BAD_PIXEL_MAP");
  const std::size_t frames = saved.utc_s.size();
  if (frames > 1 && saved.utc_s.back() > saved.utc_s.front())
    row["FRAME_RATE"] =
        static_cast<double>(frames - 1) / (saved.utc_s.back() - saved.utc_s.front());
  return row;
}

AotRow sensor_row(const Sensor& sensor, std::size_t lit) {
  const auto corner = sensor.grid.pixel_from_lenslet(-0.5, -0.5);
  return {{"UID", std::string("sensor")},
          {"TYPE", std::string("Shack-Hartmann")},
          {"SOURCE_UID", row_reference("source")},
          {"DIMENSIONS", std::int64_t{2}},
          {"N_VALID_SUBAPERTURES", static_cast<std::int64_t>(lit)},
          {"MEASUREMENTS", image_reference("MEASUREMENTS")},
          {"REF_MEASUREMENTS", image_reference("REF_MEASUREMENTS")},
          {"SUBAPERTURE_MASK", image_reference("SUBAPERTURE_MASK")},
          {"MASK_X_OFFSETS", std::vector<double>{corner[0]}},
          {"MASK_Y_OFFSETS", std::vector<double>{corner[1]}},
          {"SUBAPERTURE_SIZE", sensor.grid.pitch_px()},
          {"SUBAPERTURE_INTENSITIES", image_reference("SUBAPERTURE_INTENSITIES")},
          {"WAVELENGTH", sensor.optics.wavelength_m},
          {"DETECTOR_UID", row_reference("detector")}};
}

void write_tables(FitsFile& file, const Sensor& sensor, const SavedResults& saved,
                  std::size_t lit) {
  write_aot_table(
      file, "AOT_TIME",
      {{"UID", std::string("frames")},
       {"TIMESTAMPS", saved.utc_s},
       {"FRAME_NUMBERS", std::vector<double>(saved.sequence.begin(), saved.sequence.end())}});
  write_aot_table(file, "AOT_ATMOSPHERIC_PARAMETERS");
  write_aot_table(file, "AOT_ABERRATIONS");
  write_aot_table(file, "AOT_TELESCOPES",
                  {{"UID", std::string("telescope")},
                   {"TYPE", std::string("Main Telescope")},
                   {"SEGMENT_TYPE", std::string("Monolithic")}});
  write_aot_table(file, "AOT_SOURCES",
                  {{"UID", std::string("source")}, {"TYPE", std::string("Natural Guide Star")}});
  write_aot_table(file, "AOT_DETECTORS", detector_row(sensor, saved));
  write_aot_table(file, "AOT_SCORING_CAMERAS");
  write_aot_table(file, "AOT_WAVEFRONT_SENSORS", sensor_row(sensor, lit));
  write_aot_table(file, "AOT_WAVEFRONT_SENSORS_SHACK_HARTMANN",
                  {{"UID", std::string("sensor")},
                   {"CENTROIDING_ALGORITHM",
                    std::string(kCentroidMethodNames[static_cast<std::size_t>(sensor.method)])}});
  write_aot_table(file, "AOT_WAVEFRONT_CORRECTORS");
  write_aot_table(file, "AOT_LOOPS");
}

void write_maps(FitsFile& file, const Sensor& sensor) {
  const std::vector<std::int64_t> shape{sensor.frame_rows, sensor.frame_cols};
  const auto copy = [](const auto& map) { return std::vector<float>(map.begin(), map.end()); };
  if (!sensor.dark_adu.empty())
    write_image(file, "DARK", shape, copy(sensor.dark_adu), "adu", false);
  if (!sensor.flat.empty()) write_image(file, "FLAT_FIELD", shape, copy(sensor.flat), "", false);
  if (!sensor.bad_pixel.empty())
    write_image(file, "BAD_PIXEL_MAP", shape, copy(sensor.bad_pixel), "", false);
}

/// Copies what is Curlew's own: the vortices, all as real numbers.
void copy_vortices(FitsFile& from, FitsFile& to) {
  from.select("VORTICES");
  const auto rows = static_cast<std::size_t>(from.row_count());
  const std::vector<ColumnSpec> columns{{"FRAME", 'D', ""},
                                        {"X", 'D', ""},
                                        {"Y", 'D', ""},
                                        {"CHARGE", 'D', ""},
                                        {"CIRCULATION", 'D', "rad"},
                                        {"SIGNIFICANCE", 'D', ""},
                                        {"TRACK", 'D', ""}};
  MemoryTable table("CURLEW_VORTICES", columns);
  for (std::size_t column = 0; column < columns.size(); ++column) {
    std::vector<double> values(rows);
    if (rows > 0) from.read_column<double>(columns[column].name, 0, values);
    for (const double value : values) table.put(column, value);
  }
  table.write(to);
}

}  // namespace

void export_aot(const AotInputs& inputs, const std::string& out) {
  const Sensor sensor = read_sensor(inputs.sensor);
  FitsFile results = FitsFile::open(inputs.results);
  const SavedResults saved = read_saved(results, sensor.valid.size());
  FitsSource source({inputs.recording});
  const auto frames = static_cast<std::int64_t>(saved.sequence.size());
  if (source.frame_count() != frames)
    throw Failure(inputs.recording + " has " + std::to_string(source.frame_count()) +
                  " frames and " + inputs.results + " has " + std::to_string(frames) +
                  "; name the recording that was replayed");
  const std::vector<std::size_t> lit = lit_lenslets(sensor);
  const auto lenslets = static_cast<std::int64_t>(lit.size());
  FitsFile file = FitsFile::create(out);
  write_primary(file, saved);
  write_tables(file, sensor, saved, lit.size());
  write_image(file, "MEASUREMENTS", {frames, 2, lenslets},
              pick(saved.slopes, lit, sensor.valid.size()), "rad", true);
  write_image(file, "REF_MEASUREMENTS", {2, lenslets}, reference_slopes(sensor, lit), "rad", false);
  write_image(file, "SUBAPERTURE_INTENSITIES", {frames, lenslets},
              pick(saved.flux, lit, sensor.valid.size()), "adu", true);
  write_mask(file, sensor, lit);
  write_frames(file, source);
  write_maps(file, sensor);
  copy_vortices(results, file);
  file.commit();
}

}  // namespace curlew
