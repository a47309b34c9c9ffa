#include "acquisition/fits/confinement.h"

#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <sys/prctl.h>
#include <sys/syscall.h>

#include <array>
#include <cerrno>
#include <cstddef>
#include <cstdint>
#include <vector>

namespace curlew {
namespace {

#if defined(__x86_64__)
constexpr std::uint32_t kArchitecture = AUDIT_ARCH_X86_64;
#elif defined(__aarch64__)
constexpr std::uint32_t kArchitecture = AUDIT_ARCH_AARCH64;
#else
constexpr std::uint32_t kArchitecture = 0;
#endif

// What cfitsio, the C library and the loop of requests need. The last four are for abort().
constexpr auto kAllowed = std::to_array<std::uint32_t>(
    {SYS_read,  SYS_write,      SYS_lseek,          SYS_pread64,       SYS_fstat,
     SYS_brk,   SYS_mmap,       SYS_munmap,         SYS_mremap,        SYS_madvise,
     SYS_futex, SYS_setitimer,  SYS_getrandom,      SYS_clock_gettime, SYS_rt_sigreturn,
     SYS_exit,  SYS_exit_group, SYS_rt_sigprocmask, SYS_getpid,        SYS_gettid,
     SYS_tgkill});

constexpr std::uint16_t kLoad = BPF_LD | BPF_W | BPF_ABS;
constexpr std::uint16_t kIfEqual = BPF_JMP | BPF_JEQ | BPF_K;
constexpr std::uint16_t kReturn = BPF_RET | BPF_K;

}  // namespace

void confine_to_open_files() {
  if (kIsSanitized || kArchitecture == 0) return;
  std::vector<sock_filter> rules{
      {kLoad, 0, 0, offsetof(seccomp_data, arch)},
      {kIfEqual, 1, 0, kArchitecture},
      {kReturn, 0, 0, SECCOMP_RET_KILL_PROCESS},
      {kLoad, 0, 0, offsetof(seccomp_data, nr)},
  };
  for (const std::uint32_t call : kAllowed) {
    rules.push_back({kIfEqual, 0, 1, call});
    rules.push_back({kReturn, 0, 0, SECCOMP_RET_ALLOW});
  }
  rules.push_back({kReturn, 0, 0, SECCOMP_RET_ERRNO | EPERM});
  const sock_fprog program{static_cast<unsigned short>(rules.size()), rules.data()};
  prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0);
  prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program);
}

}  // namespace curlew
