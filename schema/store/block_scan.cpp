#include "schema/store/block_scan.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <utility>

namespace tacho::store {

BlockList list_blocks(Connection& connection, const Vocabulary& vocabulary) {
  BlockList list;
  try {
    Statement row(connection, kBlockPlaces);
    row.query();
    while (row.step()) {
      const std::optional<BlockRow> place = read_block_place(row);
      const auto number = static_cast<std::size_t>(place ? place->source : 0);
      if (!place || number >= vocabulary.source.size() || !vocabulary.source[number]) {
        ++list.bad;
      } else {
        list.blocks.push_back(*place);
      }
    }
  } catch (const SqliteError& error) {
    if (!error.damaged()) {
      throw;
    }
    list.damage = error.what();
  }
  std::stable_sort(list.blocks.begin(), list.blocks.end(),
                   [](const BlockRow& a, const BlockRow& b) { return a.row_from < b.row_from; });
  return list;
}

std::array<BlockPlaces, kSourceCount> block_places(const BlockList& list, const PartHead& head,
                                                   const AnswerQuery& query, StreamCounts& met, const Report& report) {
  std::array<BlockPlaces, kSourceCount> places;
  for (const BlockRow& place : list.blocks) {
    const Source source = *head.vocabulary.source[static_cast<std::size_t>(place.source)];
    met[{place.session, place.robot, source}].stored += place.rows;
    if (query.asks_for(place.session, place.robot, source) && place.row_from <= head.ends.row &&
        place.t_to_us >= query.window.from_us && place.t_from_us < query.window.to_us) {
      places[static_cast<std::size_t>(source)].push_back(place);
    }
  }
  if (!list.damage.empty()) {
    report(fmt::format("the rest of table block cannot be read: {}", list.damage));
  }
  if (list.bad > 0) {
    report(fmt::format("{} rows of table block are damaged and left out", list.bad));
  }
  return places;
}

bool StoredBlock::seek(std::int64_t id) {
  known_ = 0;
  if (!data_.seek(id)) {
    return false;
  }
  if (tools_->room < data_.size()) {
    tools_->room = data_.size();
    tools_->bytes = std::make_unique_for_overwrite<char[]>(tools_->room);  // memory that is not touched costs nothing
  }
  return true;
}

std::string_view StoredBlock::at(std::size_t offset, std::size_t length) {
  constexpr std::size_t kFirst = 8192;  // head, directory, shapes and row columns of most blocks
  offset = std::min(offset, data_.size());
  length = std::min(length, data_.size() - offset);
  if (known_ == 0) {
    known_ = std::min(kFirst, data_.size());
    data_.read(0, {tools_->bytes.get(), known_});
  }
  if (offset + length > known_) {
    data_.read(offset, {tools_->bytes.get() + offset, length});
  }
  return {tools_->bytes.get() + offset, length};
}

void BlockFetch::with(const BlockRow& place, Source source, const Report& report,
                      const std::function<std::string(BlockDecoder&)>& use) {
  std::string damage;
  try {
    damage = bytes_.seek(place.id) ? decoder_->open(bytes_) : "it is gone";
    const BlockHead& head = decoder_->head();
    if (damage.empty() && (head.robot != place.robot || head.source != source || head.session != place.session)) {
      damage = "it belongs to another stream";
    }
    if (damage.empty()) {
      damage = use(*decoder_);
    }
  } catch (const SqliteError& error) {
    if (!error.damaged()) {
      throw;
    }
    damage = error.what();
  }
  if (!damage.empty()) {
    report(fmt::format("block {} (robot {}, {}, session {}, polls {} to {}): {}", place.id, place.robot,
                       source_name(source), place.session, place.seq_from, place.seq_to, damage));
  }
}

BlockScan::BlockScan(Connection& connection, const BlockList& list, const PartHead& head, const AnswerQuery& query,
                     StreamCounts& met, const Report& report)
    : head_(&head), query_(&query), report_(&report), fetch_(connection, tools_) {
  auto places = block_places(list, head, query, met, report);
  for (std::size_t s = 0; s < kSourceCount; ++s) {
    if (!places[s].empty()) {
      lanes_.push_back({static_cast<Source>(s), std::move(places[s]), {}, {}, 0});
      fill(lanes_.back());
    }
  }
}

/// Opens blocks until one has answers, or none is left.
void BlockScan::fill(Lane& lane) {
  lane.rows.clear();
  lane.next = 0;
  while (lane.rows.empty() && !lane.blocks.empty()) {
    const BlockRow place = lane.blocks.front();
    lane.blocks.pop_front();
    load(lane, place);
  }
}

void BlockScan::load(Lane& lane, const BlockRow& place) {
  fetch_.with(place, lane.source, *report_, [&](BlockDecoder& block) {
    std::vector<std::int64_t> rows;
    std::string damage = block.places(rows);
    if (damage.empty()) {
      damage = block.answers([&](std::size_t i, const Answer& answer) {
        if (query_->window.contains(answer.meta.t_send_us) && rows[i] <= head_->ends.row) {
          if (lane.answers.size() <= lane.rows.size()) {
            lane.answers.emplace_back();
          }
          lane.answers[lane.rows.size()] = answer;
          lane.rows.push_back(rows[i]);
        }
      });
    }
    return damage;
  });
}

std::int64_t BlockScan::row() const {
  std::int64_t first = 0;
  for (const Lane& lane : lanes_) {
    if (lane.next < lane.rows.size() && (first == 0 || lane.rows[lane.next] < first)) {
      first = lane.rows[lane.next];
    }
  }
  return first;
}

const Answer& BlockScan::take() {
  const std::int64_t first = row();
  const auto lane = std::find_if(lanes_.begin(), lanes_.end(),
                                 [&](const Lane& l) { return l.next < l.rows.size() && l.rows[l.next] == first; });
  std::swap(answer_, lane->answers[lane->next]);
  if (++lane->next == lane->rows.size()) {
    fill(*lane);
  }
  return answer_;
}

}  // namespace tacho::store
