// Configurations: one that is read writes itself as a text that reads the same. The same bytes are
// read as several configurations of a sweep, too.
#include "service/config.h"
#include "tests/fuzz/fuzz_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  const FuzzFile file(bytes, size);
  refuse_or([&] {
    const std::string text = config_text(read_config(file.path()));
    const FuzzFile again(reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
    if (config_text(read_config(again.path())) != text) __builtin_trap();
  });
  refuse_or([&] { read_sweep(file.path(), Config()); });
  return 0;
}
