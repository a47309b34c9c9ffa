/* A reader of streams in shared memory, in C, which knows nothing of Curlew: every offset is that of
   the format. It waits by sem_wait and prints a line for every update that it sees:

     stream_reader FILE SEMAPHORE UPDATES
     count acquired_ns written_ns keyword_FRAME first last sum

   first, last and sum are those of the elements. An update that changed while it was read ten times
   over is "torn". */
#define _GNU_SOURCE
#include <fcntl.h>
#include <inttypes.h>
#include <semaphore.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>

static char *base;

static uint64_t u64(size_t at) { uint64_t v; memcpy(&v, base + at, sizeof v); return v; }
static uint32_t u32(size_t at) { uint32_t v; memcpy(&v, base + at, sizeof v); return v; }
static uint16_t u16(size_t at) { uint16_t v; memcpy(&v, base + at, sizeof v); return v; }
static int64_t ns(size_t at) { return (int64_t)u64(at) * 1000000000 + (int64_t)u64(at + 8); }

static double element(size_t i) {
  const char *data = base + 384;
  float f;
  double d;
  uint16_t w;
  switch (base[136]) {
    case 1: return (unsigned char)data[i];
    case 3: memcpy(&w, data + 2 * i, sizeof w); return w;
    case 9: memcpy(&f, data + 4 * i, sizeof f); return f;
    default: memcpy(&d, data + 8 * i, sizeof d); return d;
  }
}

static size_t element_bytes(void) {
  switch (base[136]) {
    case 1: return 1;
    case 3: return 2;
    case 9: return 4;
    default: return 8;
  }
}

int main(int argc, char **argv) {
  if (argc != 4) return 2;
  const int file = open(argv[1], O_RDWR);
  struct stat status;
  if (file < 0 || fstat(file, &status) != 0) return 3;
  base = mmap(NULL, (size_t)status.st_size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
  if (base == MAP_FAILED || strcmp(base, "2.00") != 0) return 4;
  const size_t elements = u64(128);
  const size_t data = (elements * element_bytes() + 7) / 8 * 8;
  const size_t semaphores = u16(258), keywords = u16(290), traces = u16(260);
  const size_t keywords_at = 384 + data;
  const size_t semaphores_at = keywords_at + 128 * keywords;
  const size_t pids = (4 * semaphores + 7) / 8 * 8;
  if ((size_t)status.st_size != semaphores_at + 32 * semaphores + 32 + 4 * pids + 64 * traces)
    return 5;
  if (u32(116) * (uint64_t)u32(120) != elements || u64(312) != elements * element_bytes()) return 6;
  const int number = atoi(argv[2]);
  sem_t *semaphore = (sem_t *)(base + semaphores_at + 32 * (size_t)number);
  const int32_t me = getpid();
  memcpy(base + semaphores_at + 32 * semaphores + 32 + 4 * (size_t)number, &me, sizeof me);
  for (int updates = atoi(argv[3]); updates > 0; --updates) {
    if (sem_wait(semaphore) != 0) return 7;
    int attempt = 0;
    for (; attempt < 10; ++attempt) {
      const uint64_t count = __atomic_load_n((uint64_t *)(base + 264), __ATOMIC_ACQUIRE);
      if (__atomic_load_n((uint8_t *)(base + 288), __ATOMIC_ACQUIRE) != 0) { usleep(20); continue; }
      double sum = 0.0;
      for (size_t i = 0; i < elements; ++i) sum += element(i);
      const double first = element(0), last = element(elements - 1);
      const int64_t acquired = ns(184), written = ns(200);
      const uint64_t frame = u64(keywords_at + 128 + 24);
      __atomic_thread_fence(__ATOMIC_ACQUIRE);
      if (__atomic_load_n((uint64_t *)(base + 264), __ATOMIC_ACQUIRE) != count) continue;
      printf("%" PRIu64 " %" PRId64 " %" PRId64 " %" PRIu64 " %.17g %.17g %.17g\n", count, acquired,
             written, frame, first, last, sum);
      break;
    }
    if (attempt == 10) printf("torn\n");
    fflush(stdout);
  }
  return 0;
}
