// Recordings and anybody's FITS: whatever the bytes are, there are frames or one sentence.
#include <algorithm>

#include "acquisition/recording/fits_source.h"
#include "tests/fuzz/fuzz_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  const FuzzFile file(bytes, size);
  refuse_or([&] {
    FitsSource source({file.path()});
    if (source.format().bytes() > 1U << 22U) return;  // a hole in a file makes frames for nothing
    FrameBuffer frame(source.format());
    for (int n = 0; n < 8 && source.next(frame) == Delivery::kFrame; ++n) {
    }
  });
  return 0;
}
