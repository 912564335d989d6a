#include "schema/store/coverage_writer.hpp"

namespace tacho::store {

void CoverageWriter::put_all(PartWriter& part, const WriterHead& head, std::int64_t place) {
  for (const auto& [id, state] : head.streams) {
    if (state.dirty) {
      part.put({head.session->id, id.first, id.second}, state.count);
    }
  }
  part.set_counted_to(place);
}

void CoverageWriter::put_news(PartWriter& part, const WriterHead& head) {
  for (const auto& [id, state] : head.streams) {
    if (state.news) {
      part.put({head.session->id, id.first, id.second}, state.with_news());
    }
  }
}

void CoverageWriter::committed(WriterHead& head, bool all) {
  for (auto& [id, state] : head.streams) {
    state.covered = all ? state.count : state.news ? state.with_news() : state.covered;
    state.dirty = state.dirty && !all;
    state.news = false;
  }
  commits_ = all ? 0 : commits_ + 1;
  demanded_ = demanded_ && !all;
}

}  // namespace tacho::store
