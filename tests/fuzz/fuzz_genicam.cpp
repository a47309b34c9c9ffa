// What a camera says of itself (GenICam XML) is taken or refused in one sentence.
#include <string_view>

#include "acquisition/aravis/genicam_description.h"
#include "tests/fuzz/fuzz_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  const std::string_view xml(reinterpret_cast<const char*>(bytes), size);
  refuse_or([&] { check_genicam_description(xml, "the camera"); });
  return 0;
}
