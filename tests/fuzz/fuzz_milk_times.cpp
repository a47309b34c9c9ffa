// The text of times beside a cube of milk's loggers: one line of it is one frame.
#include <sys/stat.h>
#include <unistd.h>

#include <cstdlib>
#include <fstream>
#include <string>

#include "acquisition/recording/milk_recording.h"
#include "tests/fuzz/fuzz_file.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  using namespace curlew;
  static const std::string stem = "/dev/shm/curlew-fuzz." + std::to_string(getpid());
  static const int at_end = std::atexit([] { unlink((stem + ".txt").c_str()); });
  if (at_end != 0) return -1;
  std::ofstream(stem + ".txt", std::ios::binary)
      .write(reinterpret_cast<const char*>(bytes), static_cast<std::streamsize>(size));
  refuse_or([&] {
    const auto times = read_milk_times(stem + ".fits");
    if (times && (times->sequence.size() != times->camera_ns.size() ||
                  times->sequence.size() != times->received_ns.size()))
      __builtin_trap();
  });
  return 0;
}
