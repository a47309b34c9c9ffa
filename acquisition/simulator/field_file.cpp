#include "acquisition/simulator/field_file.h"

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <sstream>
#include <vector>

#include "acquisition/fits/fits_file.h"
#include "core/error.h"

namespace curlew {
namespace {

// Selects the first image that has pixels.
ImageInfo select_first_image(FitsFile& file) {
  for (int hdu = 0; hdu < file.hdu_count(); ++hdu) {
    file.select(hdu);
    if (!file.is_image()) continue;
    ImageInfo info = file.image();
    if (!info.shape.empty() && info.elements() > 0) return info;
  }
  throw Failure(file.path() + " holds no image; give a FITS file with a complex field [2, ny, nx]");
}

// Returns the samples per lenslet, or 0 if the image does not fit.
std::int64_t samples_per_lenslet(const ImageInfo& info, int rows, int cols) {
  if (info.shape.size() != 3 || info.shape[0] != 2) return 0;
  const std::int64_t n = info.shape[2] / cols;
  const bool fits =
      n >= 2 && n <= kMaxFieldSamples && info.shape[2] == n * cols && info.shape[1] == n * rows;
  return fits ? n : 0;
}

[[noreturn]] void refuse_shape(const std::string& path, const ImageInfo& info, int rows, int cols) {
  std::ostringstream message;
  message << path << " holds an image of [";
  for (std::size_t i = 0; i < info.shape.size(); ++i) {
    message << (i == 0 ? "" : ", ") << info.shape[i];
  }
  message << "]; a field for " << rows << " x " << cols << " lenslets is [2, n*" << rows << ", n*"
          << cols << "] with the same n from 2 to " << kMaxFieldSamples
          << ", real part first, so resample it or choose other rows and cols";
  throw Failure(message.str());
}

}  // namespace

SampledField read_sampled_field(const std::string& path, int rows, int cols) {
  FitsFile file = FitsFile::open(path);
  const ImageInfo info = select_first_image(file);
  const std::int64_t n = samples_per_lenslet(info, rows, cols);
  if (n == 0) refuse_shape(path, info, rows, cols);

  SampledField field;
  field.samples_per_lenslet = static_cast<int>(n);
  field.values = Image<std::complex<float>>(rows * field.samples_per_lenslet,
                                            cols * field.samples_per_lenslet);
  const std::size_t points = field.values.size();
  std::vector<float> part(points);
  for (const bool imaginary : {false, true}) {
    file.read_pixels<float>(imaginary ? static_cast<std::int64_t>(points) : 0, part);
    for (std::size_t k = 0; k < points; ++k) {
      if (!std::isfinite(part[k])) {
        throw Failure(path + " holds a field with values that are not finite; put 0 there instead");
      }
      if (imaginary) {
        field.values[k].imag(part[k]);
      } else {
        field.values[k].real(part[k]);
      }
    }
  }
  return field;
}

void write_sampled_field(const std::string& path, const SampledField& field) {
  const Image<std::complex<float>>& values = field.values;
  std::vector<float> parts(2 * values.size());
  for (std::size_t k = 0; k < values.size(); ++k) {
    parts[k] = values[k].real();
    parts[values.size() + k] = values[k].imag();
  }
  FitsFile file = FitsFile::create(path);
  file.create_image(ElementType::kF32, {2, values.rows(), values.cols()});
  file.write_key("SAMPLES", std::int64_t{field.samples_per_lenslet}, "field points a lenslet side");
  file.write_pixels<float>(0, parts);
  file.commit();
}

}  // namespace curlew
