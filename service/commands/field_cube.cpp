#include "service/commands/field_cube.h"

#include <complex>
#include <cstddef>
#include <vector>

namespace curlew {

FieldCubeWriter::FieldCubeWriter(const std::string& path, std::int64_t frames)
    : file_(FitsFile::create(path)), frames_(frames) {}

void FieldCubeWriter::append(const SampledField& field) {
  const Image<std::complex<float>>& values = field.values;
  if (written_ == 0) {
    file_.create_image(ElementType::kF32, {frames_, 2, values.rows(), values.cols()});
    file_.write_key("SAMPLES", std::int64_t{field.samples_per_lenslet},
                    "field points a lenslet side");
  }
  std::vector<float> parts(2 * values.size());
  for (std::size_t k = 0; k < values.size(); ++k) {
    parts[k] = values[k].real();
    parts[values.size() + k] = values[k].imag();
  }
  file_.write_pixels<float>(written_, parts);
  written_ += static_cast<std::int64_t>(parts.size());
}

}  // namespace curlew
