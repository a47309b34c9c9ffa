// The commands of the program. Each adds itself, with its options, to the command line.
#pragma once

namespace CLI {
class App;
}

namespace curlew {

void add_simulate(CLI::App& app);
void add_calibrate(CLI::App& app);
void add_replay(CLI::App& app);
void add_run(CLI::App& app);
void add_control(CLI::App& app);
void add_bench(CLI::App& app);
// The next eleven are the commands of bench.
void add_bench_latency(CLI::App& bench);
void add_bench_stream(CLI::App& bench);
void add_bench_centroid(CLI::App& bench);
void add_bench_split(CLI::App& bench);
void add_bench_circulation(CLI::App& bench);
void add_bench_detect(CLI::App& bench);
void add_bench_train(CLI::App& bench);
void add_bench_classifier(CLI::App& bench);
void add_bench_false_alarms(CLI::App& bench);
void add_bench_phase(CLI::App& bench);
void add_bench_bound(CLI::App& bench);
void add_bench_track(CLI::App& bench);
// These are commands of the program again.
void add_cameras(CLI::App& app);
void add_doctor(CLI::App& app);
void add_kernel(CLI::App& app);
void add_convert(CLI::App& app);
void add_export(CLI::App& app);
void add_merge(CLI::App& app);

}  // namespace curlew
