// This file is the other end of an UnpackingProcess. It trusts nothing that it reads from the file,
// and it can do little: what goes wrong here ends this process only.
#include <fitsio.h>
#include <sched.h>
#include <sys/resource.h>
#include <sys/time.h>

#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <new>
#include <span>
#include <string>

#include "acquisition/fits/confinement.h"
#include "acquisition/fits/unpacking_process.h"
#include "acquisition/fits/unpacking_protocol.h"

namespace curlew {
namespace {

constexpr rlim_t kMemory_bytes = 512U << 20U;

// From now on this process may use so much processor time and is then ended by SIGPROF; 0 is for
// ever.
void limit_time(std::int64_t longest_ms) {
  const itimerval limit{{0, 0}, {longest_ms / 1000, longest_ms % 1000 * 1000}};
  setitimer(ITIMER_PROF, &limit, nullptr);
}

void limit_resources() {
  const auto set = [](auto resource, rlim_t most) {
    const rlimit limit{most, most};
    setrlimit(resource, &limit);
  };
  set(RLIMIT_CORE, 0);
  set(RLIMIT_FSIZE, 0);
  if (!kIsSanitized) set(RLIMIT_DATA, kMemory_bytes);
  // The thread that asks may be a real-time one.
  const sched_param plain{};
  sched_setscheduler(0, SCHED_OTHER, &plain);
}

bool send_all(const void* bytes, std::size_t count) {
  const auto* next = static_cast<const std::byte*>(bytes);
  while (count > 0) {
    const ssize_t n = write(kUnpackSocket, next, count);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) return false;
    next += n;
    count -= static_cast<std::size_t>(n);
  }
  return true;
}

UnpackReply unpack(fitsfile* file, const UnpackingProcess::Request& request, std::byte* into) {
  int status = 0;
  double nan_double = std::numeric_limits<double>::quiet_NaN();
  float nan_float = std::numeric_limits<float>::quiet_NaN();
  void* undefined = nullptr;
  if (request.undefined_is_nan && request.datatype == TDOUBLE) undefined = &nan_double;
  if (request.undefined_is_nan && request.datatype == TFLOAT) undefined = &nan_float;
  int any_undefined = 0;
  fits_movabs_hdu(file, request.hdu + 1, nullptr, &status);
  fits_read_img(file, request.datatype, request.first + 1, request.elements, undefined, into,
                &any_undefined, &status);
  if (status == MEMORY_ALLOCATION) return UnpackReply::kTooLarge;
  return status == 0 ? UnpackReply::kElementsFollow : UnpackReply::kDamaged;
}

// Answers one request; returns false if this process has to end.
bool answer(fitsfile* file, const UnpackingProcess::Request& request) {
  const auto count = static_cast<std::size_t>(request.bytes);
  const std::unique_ptr<std::byte[]> elements(new (std::nothrow) std::byte[count]());
  UnpackReply reply = UnpackReply::kTooLarge;
  if (elements) {
    limit_time(request.longest_ms);
    reply = unpack(file, request, elements.get());
    limit_time(0);
  }
  if (!send_all(&reply, sizeof(reply))) return false;
  return reply == UnpackReply::kElementsFollow && send_all(elements.get(), count);
}

[[noreturn]] void serve() {
  limit_resources();
  limit_time(UnpackingProcess::Request{}.longest_ms);
  fitsfile* file = nullptr;
  int status = 0;
  const std::string path = "/proc/self/fd/" + std::to_string(kUnpackedFile);
  fits_open_diskfile(&file, path.c_str(), READONLY, &status);
  if (status != 0) _exit(EXIT_FAILURE);
  confine_to_open_files();
  limit_time(0);
  UnpackingProcess::Request request;
  while (read_fully(kUnpackSocket, std::as_writable_bytes(std::span(&request, 1)).data(),
                    sizeof(request)) &&
         answer(file, request)) {
  }
  _exit(EXIT_SUCCESS);
}

}  // namespace

void serve_unpacking_if_asked(int argc, char** argv) {
  if (argc == 2 && std::strcmp(argv[1], kUnpackArgument) == 0) serve();
}

}  // namespace curlew
