#include "acquisition/simulator/square_fft.h"

#include <algorithm>
#include <utility>

namespace curlew {

void transpose(const Image<std::complex<float>>& a, Image<std::complex<float>>& b) {
  constexpr int kBlock = 8;  // points of a cache line
  if (b.rows() != a.cols() || b.cols() != a.rows())
    b = Image<std::complex<float>>(a.cols(), a.rows());
  for (int top = 0; top < a.rows(); top += kBlock) {
    const int bottom = std::min(top + kBlock, a.rows());
    for (int left = 0; left < a.cols(); left += kBlock) {
      const int right = std::min(left + kBlock, a.cols());
      for (int j = left; j < right; ++j) {
        for (int i = top; i < bottom; ++i) b(j, i) = a(i, j);
      }
    }
  }
}

SquareFft::SquareFft(int n) : other_(n, n) { fft_.SetFlag(Eigen::FFT<float>::Unscaled); }

void SquareFft::transform(Image<std::complex<float>>& a, bool inverse) {
  transform_rows(a, other_, inverse);
  transpose(other_, a);
  transform_rows(a, other_, inverse);
  std::swap(a, other_);
}

void SquareFft::transform_rows(const Image<std::complex<float>>& from,
                               Image<std::complex<float>>& to, bool inverse) {
  const int n = from.cols();
  for (int i = 0; i < from.rows(); ++i) {
    if (inverse) {
      fft_.inv(&to(i, 0), &from(i, 0), n);
    } else {
      fft_.fwd(&to(i, 0), &from(i, 0), n);
    }
  }
}

}  // namespace curlew
