// An Image is an owned, row-major [row, col] array on a 64-byte boundary.
#pragma once

#include <algorithm>
#include <cstddef>
#include <new>
#include <vector>

namespace curlew {

inline constexpr std::size_t kCacheLine = 64;

/// Allocates on cache-line boundaries, from which the widest vector register can load aligned.
template <typename T>
struct CacheLineAllocator {
  using value_type = T;
  CacheLineAllocator() = default;
  template <typename U>
  explicit CacheLineAllocator(const CacheLineAllocator<U>&) {}
  T* allocate(std::size_t n) {
    return static_cast<T*>(::operator new (n * sizeof(T), std::align_val_t{kCacheLine}));
  }
  void deallocate(T* p, std::size_t) noexcept {
    ::operator delete (p, std::align_val_t{kCacheLine});
  }
  template <typename U>
  bool operator==(const CacheLineAllocator<U>&) const {
    return true;
  }
};

template <typename T>
using AlignedVector = std::vector<T, CacheLineAllocator<T>>;

/// Holds a [rows, cols] array. Lenslet maps are indexed by (row, col) or by k = row*cols + col.
template <typename T>
class Image {
 public:
  Image() = default;
  Image(int rows, int cols, T fill = T{})
      : rows_(rows),
        cols_(cols),
        values_(static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols), fill) {}

  int rows() const { return rows_; }
  int cols() const { return cols_; }
  std::size_t size() const { return values_.size(); }
  bool empty() const { return values_.empty(); }

  T* data() { return values_.data(); }
  const T* data() const { return values_.data(); }
  T* begin() { return data(); }
  T* end() { return data() + size(); }
  const T* begin() const { return data(); }
  const T* end() const { return data() + size(); }

  T& operator[](std::size_t k) { return values_[k]; }
  const T& operator[](std::size_t k) const { return values_[k]; }
  T& operator()(int row, int col) { return values_[index(row, col)]; }
  const T& operator()(int row, int col) const { return values_[index(row, col)]; }

  bool contains(int row, int col) const {
    return row >= 0 && row < rows_ && col >= 0 && col < cols_;
  }
  void fill(T value) { std::fill(begin(), end(), value); }

 private:
  std::size_t index(int row, int col) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(cols_) +
           static_cast<std::size_t>(col);
  }

  int rows_ = 0;
  int cols_ = 0;
  AlignedVector<T> values_;
};

}  // namespace curlew
