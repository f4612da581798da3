// Threads of a function of the kernel that works on pieces of its input.
#pragma once

#include <exception>
#include <thread>
#include <vector>

namespace armid {

// Calls work(w) for each worker w, worker 0 in this thread; throws the first exception after all have ended.
template <typename Work>
void run_workers(int workers, const Work& work) {
  std::vector<std::exception_ptr> failures(workers);
  const auto caught = [&](int w) {
    try {
      work(w);
    } catch (...) {
      failures[w] = std::current_exception();
    }
  };
  std::vector<std::thread> others;
  for (int w = 1; w < workers; ++w) {
    try {
      others.emplace_back(caught, w);
    } catch (const std::exception&) {
      caught(w);  // no thread or no memory to be had: this one does its pieces, too
    }
  }
  caught(0);
  for (std::thread& other : others) other.join();
  for (const std::exception_ptr& failure : failures) {
    if (failure) std::rethrow_exception(failure);
  }
}

}  // namespace armid
