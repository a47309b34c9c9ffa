#include "core/polite_thread.h"

#include <pthread.h>
#include <sched.h>
#include <sys/resource.h>
#include <unistd.h>

namespace curlew {

void become_polite(const char* name, int nice) noexcept {
  pthread_setname_np(pthread_self(), name);
  const sched_param none{};
  sched_setscheduler(0, SCHED_OTHER, &none);
  setpriority(PRIO_PROCESS, static_cast<id_t>(gettid()), nice);
}

}  // namespace curlew
