// A FixedList is a list with a capacity that is set once; it counts what did not fit.
#pragma once

#include <cstddef>
#include <vector>

namespace curlew {

template <typename T>
class FixedList {
 public:
  explicit FixedList(std::size_t capacity) : items_(capacity) {}

  /// Appends the item, or counts an overflow and returns false if the list is full. Never
  /// allocates.
  bool push(const T& item) noexcept {
    if (size_ == items_.size()) {
      ++overflow_;
      return false;
    }
    items_[size_++] = item;
    return true;
  }
  /// Copies the other's items as far as they fit, and its overflow. Never allocates.
  void assign(const FixedList& other) noexcept {
    clear();
    for (const T& item : other) push(item);
    overflow_ += other.overflow_;
  }
  /// Adds items to overflow() that did not fit into the list from which this one is filled.
  void add_overflow(int items) noexcept { overflow_ += items; }
  void clear() noexcept {
    size_ = 0;
    overflow_ = 0;
  }

  /// Drops all items from index `size` on; size must be at most size().
  void shorten(std::size_t size) noexcept { size_ = size; }

  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  std::size_t capacity() const { return items_.size(); }
  int overflow() const { return overflow_; }  ///< items that did not fit since clear()
  T& operator[](std::size_t i) { return items_[i]; }
  const T& operator[](std::size_t i) const { return items_[i]; }
  T* begin() { return items_.data(); }
  T* end() { return items_.data() + size_; }
  const T* begin() const { return items_.data(); }
  const T* end() const { return items_.data() + size_; }

 private:
  std::vector<T> items_;
  std::size_t size_ = 0;
  int overflow_ = 0;
};

}  // namespace curlew
