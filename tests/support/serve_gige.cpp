// serve_gige serves a recording as a GigE Vision camera, over and over, until SIGTERM or SIGINT.
//
// It prints "ready" when a client can connect. The frame with number s, wrapped at 16 bits or
// counted on, is frame ((s − 65401) mod 65535) mod N of the recording's N
// (FakeGigeCamera::image_of).
#include <CLI/CLI.hpp>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <exception>
#include <string>
#include <vector>

#include "acquisition/recording/fits_source.h"
#include "tests/support/fake_gige_camera.h"

namespace {

int serve(const std::string& recording, const curlew::FakeGigeOptions& options) {
  curlew::FitsSource source({recording});
  curlew::FrameBuffer frame(source.format());
  std::vector<std::vector<std::byte>> images;
  while (source.next(frame) == curlew::Delivery::kFrame)
    images.emplace_back(frame.data(), frame.data() + source.format().bytes());
  curlew::FakeGigeOptions served = options;
  served.pixel_format = source.format().pixel_type == curlew::PixelType::kU8 ? "Mono8" : "Mono16";

  if (std::isfinite(source.detector().saturation_adu))
    served.saturation = source.detector().saturation_adu;

  // The signals are blocked before there are threads, so that only sigwait() gets them.
  sigset_t ends;
  sigemptyset(&ends);
  sigaddset(&ends, SIGTERM);
  sigaddset(&ends, SIGINT);
  pthread_sigmask(SIG_BLOCK, &ends, nullptr);
  const curlew::FakeGigeCamera camera(source.format().rows, source.format().cols, std::move(images),
                                      served);
  std::puts("ready");
  std::fflush(stdout);
  int signal = 0;
  sigwait(&ends, &signal);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  CLI::App app("Serves a recording as a GigE Vision camera until SIGTERM.");
  std::string recording;
  curlew::FakeGigeOptions options;
  app.add_option("recording", recording, "FITS file")->required();
  app.add_option("--address", options.address, "IPv4 address of an interface of this machine");
  app.add_option("--serial", options.serial, "the device id is Aravis-Fake-<serial>");
  app.add_option("--rate", options.frame_rate_hz, "frames a second; a client may set another");
  app.add_option("--lost-ratio", options.lost_packet_ratio, "share of packets that get lost");
  app.add_option("--exposure-us", options.image_exposure_us,
                 "exposure time at which the frames are as recorded; without it they never change");
  app.add_flag("--once", options.once, "every frame once a start, then nothing more");
  CLI11_PARSE(app, argc, argv);
  try {
    return serve(recording, options);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "serve_gige: %s\n", error.what());
    return 1;
  }
}
