// The module curlew._native: Curlew's own stages in a Python process. python/curlew/pipeline.py is
// what its users see, and _native.pyi says what each thing returns.
#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <atomic>
#include <chrono>
#include <cstring>
#include <memory>
#include <optional>
#include <string>
#include <utility>

#include "core/error.h"
#include "core/stage_timer.h"
#include "reconstruct/modes/mode_fit.h"
#include "service/results/wavefront_meter.h"
#include "service/sensor/sensor_file.h"
#include "service/stages.h"

namespace py = pybind11;

namespace curlew {
namespace {

FrameFormat format_of(const Sensor& sensor) {
  FrameFormat format;
  format.rows = sensor.frame_rows;
  format.cols = sensor.frame_cols;
  format.pixel_type = sensor.pixel_bits == 8 ? PixelType::kU8 : PixelType::kU16;
  format.offset_x_px = sensor.offset_x_px;
  format.offset_y_px = sensor.offset_y_px;
  format.binning = sensor.binning;
  return format;
}

/// One frame at a time, with all that it needs from frame to frame.
struct InProcess {
  InProcess(const Sensor& sensor, const Config& config)
      : plan(sensor, format_of(sensor), config),
        follower(plan.follower ? std::make_unique<WindowFollower>(*plan.follower) : nullptr),
        tracker(plan.tracker
                    ? std::make_unique<VortexTracker>(*plan.tracker, plan.grid.rows, plan.grid.cols,
                                                      plan.detect.candidate_capacity())
                    : nullptr),
        slot(plan, follower.get(), tracker.get()),
        frame(format_of(sensor)) {
    slot.frame = &frame;
    slot.frame_index = -1;
    frame.rows_ready = frame.format().rows;
  }

  void run_stages() noexcept {
    for (std::size_t stage = 0; stage < kStageCount; ++stage) {
      const StageTimer timer(slot.latency.stage_ns[stage]);
      kStages[stage].run(plan, slot);
    }
    slot.latency.total_ns = nanoseconds_since(frame.header.received);
  }

  const Plan plan;
  std::unique_ptr<WindowFollower> follower;
  std::unique_ptr<VortexTracker> tracker;
  FrameSlot slot;
  FrameBuffer frame;
  std::atomic<bool> busy{false};

  WavefrontMeter& meter() {
    if (!meter_) meter_.emplace(plan.split);
    return *meter_;
  }

 private:
  std::optional<WavefrontMeter> meter_;  ///< made when it is first asked for
};

/// What was found in the newest frame. Its arrays are views on the pipeline's own memory.
class FrameResults {
 public:
  explicit FrameResults(std::shared_ptr<InProcess> state) : state_(std::move(state)) {}
  const FrameSlot& slot() const { return state_->slot; }
  InProcess& state() const { return *state_; }

 private:
  std::shared_ptr<InProcess> state_;
};

py::array read_only(py::array array) {
  py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
  return array;
}

template <typename T>
py::array view_of(const Image<T>& image, const py::object& owner) {
  const py::ssize_t rows = image.rows();
  const py::ssize_t cols = image.cols();
  const auto size = static_cast<py::ssize_t>(sizeof(T));
  return read_only(
      py::array(py::dtype::of<T>(), {rows, cols}, {cols * size, size}, image.data(), owner));
}

/// Makes a property that shows a map without a copy.
template <typename Map>
auto view(Map map) {
  return [map](const py::object& self) {
    return view_of(map(self.cast<const FrameResults&>().slot()), self);
  };
}

py::array vortices_of(const py::object& self) {
  const VortexList& list = self.cast<const FrameResults&>().slot().vortices;
  return read_only(py::array(py::dtype::of<Vortex>(), {static_cast<py::ssize_t>(list.size())},
                             {static_cast<py::ssize_t>(sizeof(Vortex))}, list.begin(), self));
}

py::tuple zernike_of(const FrameResults& results) {
  ModeFit& fit = results.state().meter().fit();
  fit.fit(results.slot().slopes);
  const Eigen::VectorXd& c = fit.coefficients();
  const Eigen::VectorXd& errors = fit.find_errors(results.slot().slopes);
  return py::make_tuple(py::array(c.size(), c.data()), py::array(errors.size(), errors.data()));
}

py::dict wavefront_of(const FrameResults& results) {
  const FrameSlot& slot = results.slot();
  const WavefrontFigures figures = results.state().meter().measure(slot.split.phase, slot.slopes);
  const double wavelength_m = results.state().plan.optics.wavelength_m;
  py::dict named;
  named["rms_rad"] = figures.rms_rad;
  named["rms_nm"] = nm_of(figures.rms_rad, wavelength_m);
  named["pv_rad"] = figures.peak_to_valley_rad;
  named["pv_nm"] = nm_of(figures.peak_to_valley_rad, wavelength_m);
  named["strehl"] = figures.strehl();
  return named;
}

py::dict latency_of(const FrameResults& results) {
  const FrameLatency& latency = results.slot().latency;
  py::dict named;
  for (std::size_t i = 0; i < kStageCount; ++i)
    named[kStages[i].name] = static_cast<double>(latency.stage_ns[i]) * 1e-3;
  named["total"] = static_cast<double>(latency.total_ns) * 1e-3;
  return named;
}

class PythonPipeline {
 public:
  PythonPipeline(const std::string& sensor, const std::string& config)
      : state_(std::make_shared<InProcess>(read_sensor(sensor),
                                           config.empty() ? Config{} : read_config(config))) {}

  FrameResults process(const py::array& frame, std::optional<std::int64_t> sequence,
                       std::int64_t camera_ns, std::int64_t received_ns) {
    InProcess& state = opened();
    check(frame);
    if (state.busy.exchange(true))
      throw std::runtime_error(
          "another thread is in process() of this pipeline: give each thread one of its own");
    const void* pixels = frame.data();
    {
      const py::gil_scoped_release others_may_run;
      FrameHeader& header = state.frame.header;
      header.received = std::chrono::steady_clock::now();
      header.sequence = sequence.value_or(state.slot.frame_index < 0 ? 0 : header.sequence + 1);
      header.camera_ns = camera_ns;
      header.received_ns = received_ns;
      header.status = kFrameOk;
      std::memcpy(state.frame.data(), pixels, state.frame.format().bytes());
      ++state.slot.frame_index;
      state.run_stages();
    }
    state.busy = false;
    return FrameResults(state_);
  }

  /// Lets the memory go, as soon as no results refer to it.
  void close() {
    if (state_ && state_->busy)
      throw std::runtime_error("another thread is in process() of this pipeline: close it later");
    state_.reset();
  }

  py::tuple shape() const {
    const LensletGrid& grid = opened().plan.grid;
    return py::make_tuple(grid.rows, grid.cols);
  }
  py::tuple frame_shape() const {
    const FrameFormat& format = opened().frame.format();
    return py::make_tuple(format.rows, format.cols);
  }
  py::dtype dtype() const {
    return opened().frame.format().pixel_type == PixelType::kU8 ? py::dtype::of<std::uint8_t>()
                                                                : py::dtype::of<std::uint16_t>();
  }

 private:
  InProcess& opened() const {
    if (!state_) throw py::value_error("this pipeline is closed");
    return *state_;
  }
  void check(const py::array& frame) const {
    const FrameFormat& format = opened().frame.format();
    if (!frame.dtype().is(dtype()) && !frame.dtype().equal(dtype()))
      throw py::type_error("the frame's dtype is " + std::string(py::str(frame.dtype())) +
                           ", and the sensor's frames are " + std::string(py::str(dtype())));
    if (frame.ndim() != 2 || frame.shape(0) != format.rows || frame.shape(1) != format.cols)
      throw py::value_error("the frame's shape is " + std::string(py::str(frame.attr("shape"))) +
                            ", and the sensor's frames are " + std::string(py::str(frame_shape())));
    if ((frame.flags() & py::array::c_style) == 0)
      throw py::value_error(
          "the frame's rows are not one after the other in memory: pass "
          "numpy.ascontiguousarray(frame)");
  }

  std::shared_ptr<InProcess> state_;
};

void translate(std::exception_ptr error) {
  try {
    if (error) std::rethrow_exception(error);
  } catch (const UsageError& usage) {
    PyErr_SetString(PyExc_ValueError, usage.what());
  } catch (const Failure& failure) {
    PyErr_SetString(PyExc_RuntimeError, failure.what());
  }
}

void bind_results(py::module_& module) {
  py::class_<FrameResults>(module, "FrameResults")
      .def_property_readonly("slopes_x",
                             view([](const FrameSlot& s) -> auto& { return s.slopes.x; }))
      .def_property_readonly("slopes_y",
                             view([](const FrameSlot& s) -> auto& { return s.slopes.y; }))
      .def_property_readonly("variance_x",
                             view([](const FrameSlot& s) -> auto& { return s.slopes.variance_x; }))
      .def_property_readonly("variance_y",
                             view([](const FrameSlot& s) -> auto& { return s.slopes.variance_y; }))
      .def_property_readonly("valid",
                             view([](const FrameSlot& s) -> auto& { return s.slopes.valid; }))
      .def_property_readonly("flux",
                             view([](const FrameSlot& s) -> auto& { return s.centroids.flux_adu; }))
      .def_property_readonly("spot_x_px",
                             view([](const FrameSlot& s) -> auto& { return s.centroids.x_px; }))
      .def_property_readonly("spot_y_px",
                             view([](const FrameSlot& s) -> auto& { return s.centroids.y_px; }))
      .def_property_readonly("phase",
                             view([](const FrameSlot& s) -> auto& { return s.split.phase; }))
      .def_property_readonly("whole_phase",
                             view([](const FrameSlot& s) -> auto& { return s.whole_phase; }))
      .def_property_readonly("island",
                             view([](const FrameSlot& s) -> auto& { return s.split.island; }))
      .def_property_readonly("solenoidal_x",
                             view([](const FrameSlot& s) -> auto& { return s.split.solenoidal_x; }))
      .def_property_readonly("solenoidal_y",
                             view([](const FrameSlot& s) -> auto& { return s.split.solenoidal_y; }))
      .def_property_readonly("circulation",
                             view([](const FrameSlot& s) -> auto& { return s.circulation.value; }))
      .def_property_readonly("circulation_valid",
                             view([](const FrameSlot& s) -> auto& { return s.circulation.valid; }))
      .def_property_readonly("vortices", vortices_of)
      .def_property_readonly("frame", [](const FrameResults& r) { return r.slot().frame_index; })
      .def_property_readonly("status",
                             [](const FrameResults& r) { return r.slot().frame->header.status; })
      .def_property_readonly("n_valid",
                             [](const FrameResults& r) { return r.slot().slopes.n_valid; })
      .def_property_readonly("n_lost",
                             [](const FrameResults& r) { return r.slot().centroids.n_lost; })
      .def_property_readonly("n_islands",
                             [](const FrameResults& r) { return r.slot().split.n_islands; })
      .def_property_readonly("latency_us", latency_of)
      .def("zernike", zernike_of)
      .def("wavefront", wavefront_of);
}

}  // namespace
}  // namespace curlew

PYBIND11_MODULE(_native, module) {
  using namespace curlew;
  PYBIND11_NUMPY_DTYPE_EX(Vortex, x, "X", y, "Y", charge, "CHARGE", circulation, "CIRCULATION",
                          significance, "SIGNIFICANCE", probability, "PROBABILITY", variance_x,
                          "VAR_X", variance_y, "VAR_Y", covariance_xy, "COV_XY", velocity_x, "VX",
                          velocity_y, "VY", flags, "FLAGS", track, "TRACK");
  py::register_exception_translator(translate);
  bind_results(module);
  py::class_<PythonPipeline>(module, "Pipeline")
      .def(py::init<const std::string&, const std::string&>(), py::arg("sensor"), py::arg("config"),
           py::call_guard<py::gil_scoped_release>())
      .def("process", &PythonPipeline::process, py::arg("frame"), py::arg("sequence") = py::none(),
           py::arg("camera_ns") = 0, py::arg("received_ns") = 0)
      .def("close", &PythonPipeline::close)
      .def_property_readonly("shape", &PythonPipeline::shape)
      .def_property_readonly("frame_shape", &PythonPipeline::frame_shape)
      .def_property_readonly("dtype", &PythonPipeline::dtype);
}
