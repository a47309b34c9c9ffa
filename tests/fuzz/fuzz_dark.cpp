// Darks and flats: the mean of a stack.
#include "acquisition/recording/mean_image.h"
#include "tests/fuzz/fuzz_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  const FuzzFile file(bytes, size);
  refuse_or([&] { read_mean_image(file.path(), {.content = ImageContent::kDark}); });
  return 0;
}
