// A SquareFft makes Fourier transforms of square complex images, in float.
#pragma once

#include <complex>
#include <unsupported/Eigen/FFT>

#include "core/image.h"

namespace curlew {

/// Makes b(j, i) = a(i, j); b becomes [a.cols(), a.rows()] unless it is already.
void transpose(const Image<std::complex<float>>& a, Image<std::complex<float>>& b);

/// Transforms [n, n] images. Both directions also transpose, which saves half the passes over
/// memory: a forward and an inverse one after the other give the image back, times n².
class SquareFft {
 public:
  explicit SquareFft(int n);

  /// a(y, x) becomes Σ a(y, x) exp(−2πi (x·p + y·q)/n) at (p, q).
  void forward(Image<std::complex<float>>& a) { transform(a, false); }
  /// a(p, q) becomes Σ a(p, q) exp(+2πi (x·p + y·q)/n) at (y, x). It is not scaled.
  void inverse(Image<std::complex<float>>& a) { transform(a, true); }

 private:
  void transform(Image<std::complex<float>>& a, bool inverse);
  void transform_rows(const Image<std::complex<float>>& from, Image<std::complex<float>>& to,
                      bool inverse);

  Eigen::FFT<float> fft_;
  Image<std::complex<float>> other_;
};

}  // namespace curlew
