// TSan must not report the following: the moodycamel queue takes its blocks into use again behind
// fences, which TSan does not understand. What the queue's items hold is not excepted.
extern "C" const char* __tsan_default_suppressions();
extern "C" const char* __tsan_default_suppressions() {
  return "race:moodycamel::ConcurrentQueue\n";
}
