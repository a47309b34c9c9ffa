// PNG, TIFF and npy: whatever the bytes are, there are frames or one sentence.
#include <algorithm>
#include <vector>

#include "acquisition/pictures/picture_stack.h"
#include "tests/fuzz/fuzz_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  const FuzzFile file(bytes, size);
  refuse_or([&] {
    PictureStack stack(file.path());
    const PictureFormat& format = stack.format();
    if (format.pixels() > 1U << 20U) return;  // few bytes say so, and it is zeros for a long time
    std::vector<double> pixels(format.pixels());
    for (std::int64_t n = 0; n < std::min<std::int64_t>(format.frames, 8); ++n)
      stack.read(n, PixelRegion{0, 0, format.cols, format.rows}, std::span(pixels));
  });
  return 0;
}
